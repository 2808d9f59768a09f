// SPDX-License-Identifier: Apache-2.0
// GET /home: the sentence, sources, warnings and tiles of the Overview.
#include <fmt/format.h>
#include <sys/statvfs.h>

#include <algorithm>
#include <optional>

#include "dashboard/server/api/context.h"
#include "dashboard/server/api/curriculum.h"
#include "services/core/command.h"
#include "services/core/statistics.h"
#include "services/monitor/sentence.h"

namespace etude::api {
namespace {

using monitor::CollectionFacts;
using monitor::EvaluationFacts;
using monitor::Facts;
using monitor::PolicyFacts;
using monitor::TrainingFacts;
using sources::Found;
using sources::Kind;
using sources::Maybe;
using sources::PartOf;
using sources::TextOf;
using sources::TimeJson;

constexpr std::size_t kMostSources = 100;
constexpr std::size_t kMostLooked = 40;  // of a kind: the Overview is asked for all the time
constexpr std::size_t kMostEvents = 12;

template <class View, class State>
struct Item {
  Found found;  // folder empty: seen on the bus only
  std::shared_ptr<const View> view;
  State state;
  std::string name;
};
using DatasetItem = Item<sources::DatasetView, CampaignState>;
using RunItem = Item<sources::RunView, RunState>;
using EvalItem = Item<sources::EvalView, std::string>;

// Everything that /home is made of.
struct Gathered {
  std::shared_ptr<const live::LiveView> live;
  std::vector<DatasetItem> datasets;
  std::vector<RunItem> runs;
  std::vector<EvalItem> evals;
  std::vector<std::string> unreadable;  // what could not be read, and why
  std::map<Kind, std::size_t> more;     // that were not looked at
};

// Adds one of a kind, or why it cannot be read.
template <class Item, class Opened, class StateOfView>
void GatherOne(const Found& found, const Result<Opened>& opened, StateOfView&& state, std::vector<Item>& items,
               std::vector<std::string>& unreadable) {
  if (!opened)
    unreadable.push_back(found.shown + ": " + opened.error().message);
  else
    items.push_back({found, opened->view, state(*opened->view), found.name});
}

void GatherFiles(Context& context, Gathered& all) {
  const auto of_bus = [&](const auto& view) { return StateOf(&view, LiveOf(*all.live, view)); };
  for (const Kind kind : {Kind::kDataset, Kind::kRun, Kind::kEval}) {
    const auto newest = context.sources.catalog().NewestOf(kind, kMostLooked);
    all.more[kind] = newest.more;
    for (const auto& found : newest.found) {
      if (kind == Kind::kDataset)
        GatherOne(found, OpenDataset(context, found.id), of_bus, all.datasets, all.unreadable);
      else if (kind == Kind::kRun)
        GatherOne(found, OpenRun(context, found.id), of_bus, all.runs, all.unreadable);
      else
        GatherOne(found, OpenEval(context, found.id), EvalState, all.evals, all.unreadable);
    }
  }
}

Gathered Gather(Context& context) {
  Gathered all;
  all.live = context.live();
  GatherFiles(context, all);
  for (const auto& [id, campaign] : all.live->campaigns) {
    const bool known =
        std::ranges::any_of(all.datasets, [&](const auto& item) { return item.view->info.identity == id; });
    if (known || !campaign.present) continue;
    Found found;
    found.id = BusId(campaign.presence);
    all.datasets.push_back({found, nullptr, StateOf(nullptr, &campaign), campaign.presence.name});
  }
  for (const auto& [id, run] : all.live->runs) {
    const bool known = std::ranges::any_of(all.runs, [&](const auto& item) { return item.view->identity == id; });
    if (known || !run.present) continue;
    Found found;
    found.kind = Kind::kRun;
    found.id = BusId(run.presence);
    all.runs.push_back({found, nullptr, StateOf(nullptr, &run), run.presence.name});
  }
  return all;
}

// What is under way counts before what changed last.
template <class Items, class Of>
auto Newest(const Items& items, Of&& updated) -> decltype(&items[0]) {
  decltype(&items[0]) newest = nullptr;
  for (const auto& item : items)
    if (!newest || updated(item) > updated(*newest)) newest = &item;
  return newest;
}
const DatasetItem* NewestDataset(const Gathered& all) {
  std::vector<const DatasetItem*> collections;
  for (const auto& item : all.datasets)
    if (item.found.eval.empty()) collections.push_back(&item);
  const auto newest = Newest(collections, [](const auto* item) { return item->state.updated; });
  return newest ? *newest : nullptr;
}
const RunItem* NewestRun(const Gathered& all) {
  return Newest(all.runs, [](const auto& item) { return item.state.updated; });
}
const EvalItem* NewestEval(const Gathered& all) {
  return Newest(all.evals, [](const auto& item) { return item.view->updated; });
}

OrderedJson SourceJson(const std::string& kind, const Found& found, const std::string& name, const std::string& state,
                       double updated, bool live) {
  const bool dataset = found.kind == Kind::kDataset && !found.folder.empty();
  return {{"id", found.id},
          {"kind", kind},
          {"name", name},
          {"state", state},
          {"updated", TimeJson(updated)},
          {"age_ms", AgeOf(updated)},
          {"live", live},
          {"folder", sources::TextOrNull(found.shown)},
          {"role", dataset ? OrderedJson(found.eval.empty() ? "demonstrations" : "rollouts") : OrderedJson()}};
}

OrderedJson SourcesJson(const Gathered& all) {
  std::vector<std::pair<double, OrderedJson>> rows;
  for (const auto& item : all.datasets)
    rows.emplace_back(item.state.updated, SourceJson(item.view ? "dataset" : "campaign", item.found, item.name,
                                                     item.state.state, item.state.updated, item.state.live));
  for (const auto& item : all.runs)
    rows.emplace_back(item.state.updated,
                      SourceJson("run", item.found, item.name, item.state.state, item.state.updated, item.state.live));
  for (const auto& item : all.evals)
    rows.emplace_back(item.view->updated,
                      SourceJson("eval", item.found, item.name, item.state, item.view->updated, false));
  std::ranges::stable_sort(rows, std::greater<>(), [](const auto& row) { return row.first; });
  OrderedJson json = OrderedJson::array();
  for (auto& [updated, row] : rows)
    if (json.size() < kMostSources) json.push_back(std::move(row));
  return json;
}

// ---- warnings ---------------------------------------------------------------------------------

OrderedJson Warning(const char* code, const std::string& text, const std::string& link, double since = 0) {
  return {{"code", code}, {"text", text}, {"since", TimeJson(since)}, {"link", link}};
}

void WarnOfCampaigns(const Gathered& all, OrderedJson& warnings) {
  constexpr std::int64_t kSilent_ms = 3000, kNoCommit_ms = 60'000;
  for (const auto& [id, campaign] : all.live->campaigns) {
    if (!campaign.present || !campaign.status) continue;
    const auto& name = campaign.presence.name;
    const bool finished = campaign.complete || campaign.status->committed >= campaign.status->total;
    if (!campaign.status->error.empty())
      warnings.push_back(Warning("campaign_error", name + ": " + campaign.status->error, "/generation"));
    if (!finished && campaign.status->workers > 0 && live::AgeMs(campaign.changed) > kNoCommit_ms)
      warnings.push_back(Warning("no_commits",
                                 fmt::format("{}: no commit for {} s with {} workers", name,
                                             live::AgeMs(campaign.changed) / 1000, campaign.status->workers),
                                 "/fleet", WallSeconds() - static_cast<double>(live::AgeMs(campaign.changed)) / 1000));
    for (const auto& [worker, heard] : campaign.workers)
      if (const auto age = live::AgeMs(heard.heard); !finished && age > kSilent_ms && warnings.size() < 50)
        warnings.push_back(Warning("worker_silent", fmt::format("worker {} silent for {} s", worker, age / 1000),
                                   "/fleet?filter=" + worker, WallSeconds() - static_cast<double>(age) / 1000));
  }
  for (const auto& item : all.datasets) {
    if (item.state.given_up > 0 && item.found.eval.empty())
      warnings.push_back(
          Warning("given_up", fmt::format("{}: {} given up", item.name, item.state.given_up), "/generation"));
    if (item.view && item.view->info.unreadable > 0)
      warnings.push_back(Warning(
          "unreadable",
          fmt::format("{}: {} files unreadable; etude dataset verify says more", item.name, item.view->info.unreadable),
          "/dataset?dataset=" + item.found.id));
  }
}

void WarnOfRuns(const Gathered& all, OrderedJson& warnings) {
  constexpr double kDataWait = 0.2;
  for (const auto& item : all.runs) {
    const std::string link = "/training?run=" + item.found.id;
    if (item.state.state == "running" && item.state.data_wait.value_or(0) > kDataWait)
      warnings.push_back(Warning(
          "data_wait", fmt::format("{}: waits for data {:.0f} % of the time", item.name, 100 * *item.state.data_wait),
          link));
    if (item.state.state == "failed") warnings.push_back(Warning("run_failed", item.name + ": training failed", link));
    if (!item.view) continue;
    const auto loss = item.view->metrics.series().find("train/loss");
    if (loss != item.view->metrics.series().end() && loss->second.nulls > 0)
      warnings.push_back(Warning(
          "loss_not_finite", fmt::format("{}: the loss was not finite {} times", item.name, loss->second.nulls), link));
    for (const auto& line : item.view->curriculum)
      if (TextOf(line, "cause") == "budget")
        warnings.push_back(Warning("stage_budget",
                                   fmt::format("{}: stage {} ended by its budget, not by its goal", item.name,
                                               sources::UnsignedOf(line, "from").value_or(0)),
                                   link));
  }
}

void WarnOfDisks(Context& context, OrderedJson& warnings) {
  constexpr double kLeast = 0.1;
  std::set<unsigned long> seen;
  for (const auto& root : context.sources.catalog().roots()) {
    struct statvfs disk {};
    if (::statvfs(root.c_str(), &disk) != 0 || disk.f_blocks == 0 || !seen.insert(disk.f_fsid).second) continue;
    const double free = static_cast<double>(disk.f_bavail) / static_cast<double>(disk.f_blocks);
    if (free < kLeast)
      warnings.push_back(
          Warning("disk", fmt::format("disk of {} {:.0f} % free", root.filename().string(), 100 * free), "/fleet"));
  }
}

// What processes and policy servers say of themselves.
void WarnOfProcesses(const Gathered& all, OrderedJson& warnings) {
  constexpr double kLeast = 0.1;
  constexpr std::int64_t kSilent_ms = 3000;
  std::set<std::string> disks;
  for (const auto& [process, heard] : all.live->processes) {
    const auto& status = heard.message;
    if (warnings.size() >= 100) break;
    // one without a folder says nothing of a disk
    const auto total = static_cast<double>(status.disk_total_bytes);
    const double free = total > 0 ? static_cast<double>(status.disk_free_bytes) / total : 1;
    if (free < kLeast && disks.insert(status.host + status.folder).second)
      warnings.push_back(Warning("disk",
                                 fmt::format("disk of {} on {} {:.0f} % free", status.role, status.host, 100 * free),
                                 "/fleet?filter=" + status.host));
    const std::set<std::string> lasting{"collector", "trainer", "policy"};
    if (const auto age = live::AgeMs(heard.at); lasting.contains(status.role) && age > kSilent_ms)
      warnings.push_back(Warning("process_silent",
                                 fmt::format("{} on {} silent for {} s", status.role, status.host, age / 1000),
                                 "/fleet?filter=" + status.host, WallSeconds() - static_cast<double>(age) / 1000));
  }
  for (const auto* server : ServersOf(*all.live))
    if (!server->status.last_refusal.empty())
      warnings.push_back(
          Warning("policy_refuses",
                  fmt::format("policy on {} refused: {}", server->status.host, server->status.last_refusal), "/logs"));
  for (const auto& [id, campaign] : all.live->campaigns) {
    std::set<std::string> of_campaign;
    for (const auto& [worker, heard] : campaign.workers)
      if (const auto print = all.live->prints.find(worker); print != all.live->prints.end())
        of_campaign.insert(print->second);
    if (campaign.present && of_campaign.size() > 1)
      warnings.push_back(
          Warning("fingerprint", campaign.presence.name + ": workers are ready for different work", "/fleet"));
  }
}

OrderedJson Warnings(Context& context, const Gathered& all) {
  OrderedJson warnings = OrderedJson::array();
  WarnOfCampaigns(all, warnings);
  WarnOfRuns(all, warnings);
  WarnOfDisks(context, warnings);
  WarnOfProcesses(all, warnings);
  for (const auto& text : all.unreadable) warnings.push_back(Warning("unreadable", text, "/logs"));
  for (const auto& [kind, more] : all.more)
    if (more > 0)
      warnings.push_back(Warning("not_shown",
                                 fmt::format("{} more {}s, which changed before those shown, are not shown: name fewer "
                                             "folders with --dir",
                                             more, sources::ToString(kind)),
                                 "/"));
  return warnings;
}

// ---- tiles ------------------------------------------------------------------------------------

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

OrderedJson DemonstrationsTile(const Gathered& all) {
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

OrderedJson TrainingTile(const Gathered& all) {
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

// Of the server that was heard answering most; without one that says how it does, of who has announced itself.
OrderedJson PolicyTile(const Gathered& all) {
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
          {"episodes", sources::UnsignedOf(item.view->report, "episodes").value_or(0)},
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

OrderedJson SuccessTile(const Gathered& all) {
  const auto* eval = NewestEval(all);
  if (eval && !eval->view->rows.empty()) return EvalTile(*eval);
  const auto* dataset = NewestDataset(all);
  return dataset && dataset->view && !dataset->view->rows.empty() ? ExpertTile(*dataset) : OrderedJson();
}

OrderedJson LadderTile(const Gathered& all) {
  const auto* run = NewestRun(all);
  if (!run || !run->view) return nullptr;
  return {{"source", run->found.id}, {"stages", StagesJson(*run->view, run->state)}};
}

OrderedJson Events(const Gathered& all) {
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
          "/generation");
    }
  for (const auto& [event] : *all.live->events)
    add(static_cast<double>(event.time_ms) / 1000, event.level == "error" ? "error" : "warn",
        fmt::format("{} on {}: {}", event.role, event.host, event.text), "/logs");
  std::ranges::stable_sort(events, std::greater<>(), [](const auto& event) { return event.first; });
  OrderedJson json = OrderedJson::array();
  for (auto& [t, event] : events)
    if (json.size() < kMostEvents) json.push_back(std::move(event));
  return json;
}

Facts FactsOf(Context& context, const Gathered& all) {
  Facts facts;
  if (const auto* item = NewestDataset(all))
    facts.collection = CollectionFacts{item->name,
                                       item->state.control.empty() ? item->state.state : item->state.control,
                                       item->state.committed,
                                       item->state.total,
                                       item->state.given_up,
                                       item->state.eta_s};
  if (const auto* item = NewestRun(all))
    facts.training = TrainingFacts{item->state.state, item->state.stage_name, item->state.stage,    item->state.stages,
                                   item->state.step,  item->state.eta_s,      item->state.elapsed_s};
  if (!all.live->policies.empty()) {
    const auto servers = ServersOf(*all.live);
    facts.policy = servers.size() == 1 ? monitor::FactsOf(servers.front()->status)
                                       : PolicyFacts{std::nullopt, all.live->policies.size(), std::nullopt, true};
  }
  if (const auto* item = NewestEval(all)) {
    const auto& success = PartOf(PartOf(item->view->report, "overall"), "success");
    facts.evaluation =
        EvaluationFacts{item->state, sources::NumberOf(success, "share").value_or(0), item->view->rows.size(),
                        sources::UnsignedOf(item->view->report, "episodes").value_or(0)};
  }
  std::string places;
  for (const auto& root : context.sources.catalog().roots()) places += (places.empty() ? "" : ", ") + root.string();
  if (context.domain >= 0) places += fmt::format("{}domain {}", places.empty() ? "" : " and on ", context.domain);
  facts.looked_in = places.empty() ? "no folder and on no bus" : places;
  return facts;
}

// of the most telling part
std::string StateOfAll(const Gathered& all) {
  std::vector<std::string> states;
  if (const auto* item = NewestDataset(all)) states.push_back(item->state.state);
  if (const auto* item = NewestRun(all)) states.push_back(item->state.state);
  if (const auto* item = NewestEval(all)) states.push_back(item->state);
  for (const char* state : {"failed", "running", "silent", "stopped", "finished"})
    if (std::ranges::find(states, state) != states.end()) return state;
  return "unknown";
}

}  // namespace

OrderedJson HomeJson(Context& context) {
  const Gathered all = Gather(context);
  OrderedJson dirs = OrderedJson::array();
  for (const auto& root : context.sources.catalog().roots()) dirs.push_back(root.string());
  OrderedJson tiles{{"demonstrations", DemonstrationsTile(all)},
                    {"training", TrainingTile(all)},
                    {"policy", PolicyTile(all)},
                    {"success", SuccessTile(all)},
                    {"ladder", LadderTile(all)},
                    {"events", Events(all)}};
  return {{"sentence", monitor::Sentence(FactsOf(context, all))},
          {"state", StateOfAll(all)},
          {"time", sources::Rfc3339(WallSeconds())},
          {"version", Version()},
          {"dirs", dirs},
          {"domain", context.domain >= 0 ? OrderedJson(context.domain) : OrderedJson()},
          {"actions", context.security.enabled()},
          {"sources", SourcesJson(all)},
          {"warnings", Warnings(context, all)},
          {"tiles", http::ForBrowsers(tiles)}};
}

void AddHomeRoutes(http::Router& router, Context& context) {
  router.Add("GET", kPrefix + "/home", http::Lane::kFiles,
             [&context](const http::Request&) -> Result<http::Answer> { return http::JsonAnswer(HomeJson(context)); });
  router.Add(
      "GET", "/healthz", http::Lane::kFiles,
      [](const http::Request&) -> Result<http::Answer> { return http::BytesAnswer("ok\n", "text/plain"); },
      http::Access::kPublic);
  router.Add(
      "GET", "/readyz", http::Lane::kFiles,
      [&context](const http::Request&) -> Result<http::Answer> {
        const auto live = context.live();
        const bool bus = context.domain >= 0 && live->error.empty();
        const bool ready = context.domain < 0 || bus;
        // a probe comes without a token: it learns no names
        OrderedJson json{{"ready", ready},
                         {"sentence", ready ? "ready" : "the bus is not read"},
                         {"sources", context.sources.catalog().List()->size()},
                         {"bus", bus}};
        return http::JsonAnswer(json, ready ? 200 : 503);
      },
      http::Access::kPublic);
}

}  // namespace etude::api
