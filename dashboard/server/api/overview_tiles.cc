// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <optional>
#include <utility>

#include "dashboard/server/api/curriculum.h"
#include "dashboard/server/api/overview.h"
#include "services/core/statistics.h"
#include "services/episode/bounded_json.h"

namespace etude::api {
namespace {

using sources::Maybe;
using sources::PartOf;
using sources::TextOf;
using sources::TimeJson;

constexpr std::size_t kMostEvents = 12;

// Commits per minute of the last ten minutes of collection, a value each ten seconds.
OrderedJson HistoryOfFiles(const sources::DatasetView& view) {
  constexpr double kBin_s = 10;
  constexpr int kBins = 60;
  double last = 0;
  for (const auto& row : view.rows) last = std::max(last, row.t.value_or(0));
  if (last <= 0) return OrderedJson::array();
  std::vector<double> bins(kBins, 0);
  for (const auto& row : view.rows) {
    if (!row.t) continue;
    const auto back = static_cast<int>((last - *row.t) / kBin_s);
    if (back >= 0 && back < kBins) bins[static_cast<std::size_t>(kBins - 1 - back)] += 60 / kBin_s;
  }
  return bins;
}

OrderedJson DemonstrationsTile(const Overview& all) {
  const auto* item = NewestDataset(all);
  if (!item) return nullptr;
  const auto& state = item->state;
  OrderedJson history = OrderedJson::array();
  if (item->view) {
    const auto* heard = LiveOf(*all.live, *item->view);
    history = heard && heard->per_minute.size() > 1 ? OrderedJson(heard->per_minute) : HistoryOfFiles(*item->view);
  }
  return {{"source", item->found.id},
          {"name", item->name},
          {"committed", state.committed},
          {"total", state.total},
          {"given_up", state.given_up},
          {"failed", state.failed},
          {"workers", state.workers},
          {"per_min", Maybe(state.per_minute)},
          {"eta_s", Maybe(state.eta_s)},
          {"history_per_min", history},
          {"live", state.live}};
}

OrderedJson ErrorsOf(const sources::RunView* view) {
  OrderedJson errors = OrderedJson::object();
  if (!view) return errors;
  for (const auto& [key, series] : view->metrics.series()) {
    constexpr std::string_view kValid = "valid/";
    const auto last = view->metrics.Last(key);
    if (key.starts_with(kValid) && key != "valid/loss" && last) errors[key.substr(kValid.size())] = *last;
  }
  return errors;
}

OrderedJson TrainingTile(const Overview& all) {
  const auto* item = NewestRun(all);
  if (!item) return nullptr;
  const auto& state = item->state;
  OrderedJson json{{"source", item->found.id}, {"name", item->name}};
  json.update(ProgressJson(state));
  json.update(OrderedJson{{"steps", Maybe(state.steps)},
                          {"finished", state.state == "finished"},
                          {"errors", ErrorsOf(item->view.get())},
                          {"live", state.live}});
  return json;
}

// What was saved last in the newest run, on disk or as its trainer says, and the servers of that run.
OrderedJson CheckpointTile(const Overview& all) {
  const auto* item = NewestRun(all);
  if (!item) return nullptr;
  std::optional<std::uint64_t> step = item->state.checkpoint_step;
  OrderedJson file, age;
  if (item->view && !item->view->checkpoints.empty()) {
    const auto& newest = item->view->checkpoints.front();
    const auto text = newest.metadata.find("step");
    const auto number = text == newest.metadata.end() ? std::nullopt : ParseBoundedJson(text->second);
    const auto saved =
        number && number->is_number_unsigned() ? std::optional(number->get<std::uint64_t>()) : std::nullopt;
    // one that is published and not on this disk is newer, and of it no more is known
    if (saved && *saved >= step.value_or(0)) {
      step = saved;
      file = newest.file;
      age = AgeOf(newest.stamp.modified_s());
    }
  }
  if (!step) return nullptr;
  OrderedJson servers = OrderedJson::array();
  if (item->view && !item->view->identity.empty())
    for (const auto* server : ServersOf(*all.live, item->view->identity))
      servers.push_back({{"host", server->status.host},
                         {"step", server->status.step},
                         {"since", TimeJson(static_cast<double>(server->status.since))}});
  return {{"source", item->found.id}, {"name", item->name}, {"step", *step}, {"file", file}, {"age_ms", age},
          {"servers", servers}};
}

// Of the server that was heard answering most; without one that says how it does, of who has announced itself.
OrderedJson PolicyTile(const Overview& all) {
  if (all.live->policies.empty()) return nullptr;
  const auto servers = ServersOf(*all.live);
  const auto busiest =
      std::ranges::max_element(servers, {}, [](const auto* server) { return server->status.answered; });
  const live::LiveServer* server = busiest == servers.end() ? nullptr : *busiest;
  const std::string run_id = server ? server->status.run_id : all.live->policies.front().presence.id;
  const auto ours =
      std::ranges::find_if(all.runs, [&](const auto& item) { return item.view && item.view->identity == run_id; });
  OrderedJson json{{"source", ours == all.runs.end() ? OrderedJson() : OrderedJson(ours->found.id)},
                   {"name", server ? server->status.run : all.live->policies.front().presence.name},
                   {"instances", all.live->policies.size()}};
  if (!server) {
    json.update(OrderedJson::parse(R"({"checkpoint_step": null, "age_ms": null, "p50_ms": null, "p95_ms": null,
        "answers_per_s": null, "sessions": null, "may_drive": null, "last_refusal": null})"));
    return json;
  }
  const auto& status = server->status;
  json.update(OrderedJson{{"checkpoint_step", status.step},
                          {"age_ms", live::AgeMs(server->heard)},
                          {"p50_ms", status.p50_ms},
                          {"p95_ms", status.p95_ms},
                          {"answers_per_s", Maybe(server->AnswersPerSecond())},
                          {"sessions", status.sessions},
                          {"may_drive", status.control_trained},
                          {"last_refusal", sources::TextOrNull(status.last_refusal)}});
  return json;
}

OrderedJson ShareJson(std::uint64_t successes, std::uint64_t n) {
  const Interval interval = WilsonInterval(successes, n);
  return {{"successes", successes},
          {"share", n == 0 ? 0.0 : static_cast<double>(successes) / static_cast<double>(n)},
          {"low", interval.low},
          {"high", interval.high}};
}

OrderedJson TaskShare(const std::string& task, std::uint64_t successes, std::uint64_t n) {
  return {{"task", task}, {"n", n}, {"success", ShareJson(successes, n)}, {"success_latched", nullptr}};
}

OrderedJson TaskOfReport(const OrderedJson& summary) {
  return {{"task", TextOf(summary, "task")},
          {"n", sources::UnsignedOf(summary, "n").value_or(0)},
          {"success", PartOf(summary, "success").is_object() ? PartOf(summary, "success") : ShareJson(0, 0)},
          {"success_latched", PartOf(summary, "success_latched")}};
}

OrderedJson EvalTile(const EvalItem& item) {
  OrderedJson tasks = OrderedJson::array();
  for (const auto& summary : PartOf(item.view->report, "per_task")) tasks.push_back(TaskOfReport(summary));
  return {{"source", item.found.id},
          {"kind", "eval"},
          {"name", item.name},
          {"done", item.view->rows.size()},
          {"episodes", WantedRollouts(*item.view)},
          {"tasks", tasks},
          {"overall", TaskOfReport(PartOf(item.view->report, "overall"))}};
}

// No evaluation yet: attempts of the expert that were committed, of all that were made.
OrderedJson ExpertTile(const DatasetItem& item) {
  std::map<std::string, std::pair<std::uint64_t, std::uint64_t>> tasks;  // successes, n
  for (const auto& row : item.view->rows) ++tasks[row.task].first, ++tasks[row.task].second;
  for (const auto& row : item.view->failures) ++tasks[row.task].second;
  OrderedJson rows = OrderedJson::array();
  std::uint64_t successes = 0, n = 0;
  for (const auto& [task, counts] : tasks) {
    if (!task.empty()) rows.push_back(TaskShare(task, counts.first, counts.second));
    successes += counts.first, n += counts.second;
  }
  return {{"source", item.found.id},
          {"kind", "expert"},
          {"name", item.name},
          {"done", successes},
          {"episodes", n},
          {"tasks", rows},
          {"overall", TaskShare("overall", successes, n)}};
}

OrderedJson SuccessTile(const Overview& all) {
  const auto* eval = NewestEval(all);
  if (eval && !eval->view->rows.empty()) return EvalTile(*eval);
  const auto* dataset = NewestDataset(all);
  return dataset && dataset->view && !dataset->view->rows.empty() ? ExpertTile(*dataset) : OrderedJson();
}

OrderedJson LadderTile(const Overview& all) {
  const auto* run = NewestRun(all);
  if (!run || !run->view) return nullptr;
  return {{"source", run->found.id}, {"stages", StagesJson(*run->view, run->state)}};
}

OrderedJson Events(const Overview& all) {
  std::vector<std::pair<double, OrderedJson>> events;
  const auto add = [&](double t, const char* level, std::string text, std::string link) {
    events.emplace_back(t, OrderedJson{{"t", sources::Rfc3339(t)}, {"level", level}, {"text", text}, {"link", link}});
  };
  for (const auto& item : all.runs) {
    if (!item.view) continue;
    const std::string link = "/training?run=" + item.found.id;
    for (const auto& header : item.view->checkpoints) {
      if (!header.error.empty()) continue;
      const auto step = header.metadata.find("step");
      add(header.stamp.modified_s(), "info",
          fmt::format("{}: checkpoint {}", item.name, step == header.metadata.end() ? header.file : step->second),
          "/checkpoints?run=" + item.found.id);
    }
    if (const auto& end = item.view->metrics.end(); end && end->t)
      add(*end->t, end->cause == "failed" ? "error" : "info", item.name + ": training " + end->cause, link);
  }
  for (const auto& item : all.evals)
    if (item.state == "finished")
      add(item.view->updated, "info", fmt::format("{}: {} rollouts", item.name, item.view->rows.size()),
          "/evaluation?eval=" + item.found.id);
  for (const auto& [id, campaign] : all.live->campaigns)
    for (std::size_t i = 0; i < std::min(campaign.attempts.size(), kMostEvents); ++i) {
      const auto& attempt = campaign.attempts[i];
      add(attempt.t, "warn",
          fmt::format("{}: #{} {}", campaign.presence.name, attempt.report.index, attempt.report.outcome),
          fmt::format("{}&index={}", GenerationLink(all, id, campaign), attempt.report.index));
    }
  for (const auto& [event, order_ms] : *all.live->events)
    add(static_cast<double>(order_ms) / 1000, event.level == "error" ? "error" : "warn",
        fmt::format("{} on {}: {}", event.role, event.host, event.text), "/logs");
  std::ranges::stable_sort(events, std::greater<>(), [](const auto& event) { return event.first; });
  OrderedJson json = OrderedJson::array();
  for (auto& [t, event] : events)
    if (json.size() < kMostEvents) json.push_back(std::move(event));
  return json;
}

}  // namespace

OrderedJson TilesJson(const Overview& all) {
  return {{"demonstrations", DemonstrationsTile(all)},
          {"training", TrainingTile(all)},
          {"checkpoint", CheckpointTile(all)},
          {"policy", PolicyTile(all)},
          {"success", SuccessTile(all)},
          {"ladder", LadderTile(all)},
          {"events", Events(all)}};
}

}  // namespace etude::api
