// SPDX-License-Identifier: Apache-2.0
// GET /metrics: what Grafana and alerts read, in Prometheus' text format. Labels are names of campaigns, runs, tasks,
// reasons, hosts, roles and topics only: one a worker would grow without end.
#include "dashboard/server/api/metrics.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <sstream>

#include "dashboard/server/api/context.h"
#include "dashboard/server/api/counters.h"
#include "services/episode/bounded_json.h"

namespace etude::api {
namespace {

std::string Escaped(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '\\' || c == '"') escaped += '\\';
    if (c == '\n')
      escaped += "\\n";
    else
      escaped += c;
  }
  return escaped;
}

// Families in the order in which they are first named.
class Exposition {
 public:
  void Family(const char* name, const char* type, const char* help) {
    text_ += fmt::format("# HELP {} {}\n# TYPE {} {}\n", name, help, name, type);
  }
  void Sample(const std::string& name, const std::vector<std::pair<const char*, std::string>>& labels, double value) {
    text_ += name;
    for (std::size_t i = 0; i < labels.size(); ++i)
      text_ += fmt::format("{}{}=\"{}\"", i == 0 ? "{" : ",", labels[i].first, Escaped(labels[i].second));
    text_ += fmt::format("{} {}\n", labels.empty() ? "" : "}", value);
  }
  std::string Take() { return std::move(text_); }

 private:
  std::string text_;
};

struct DatasetMetrics {
  std::string id;
  std::shared_ptr<const sources::DatasetView> view;  // null: on the bus alone
  CampaignState state;
  std::string failures_json;  // what is heard of failed attempts, by reason, where there is no view
};
struct RunMetrics {
  std::string id;
  std::shared_ptr<const sources::RunView> view;  // null: on the bus alone
  RunState state;
};

// By reason and task; its collector does not say the tasks.
std::map<std::pair<std::string, std::string>, std::uint64_t> FailedAttempts(const DatasetMetrics& dataset) {
  std::map<std::pair<std::string, std::string>, std::uint64_t> counts;
  if (dataset.view) {
    for (const auto& row : dataset.view->failures) ++counts[{row.outcome, row.task}];
    return counts;
  }
  const OrderedJson heard = ParseBoundedJson(dataset.failures_json).value_or(OrderedJson());
  if (!heard.is_object()) return counts;
  for (const auto& [reason, count] : heard.items())
    if (count.is_number_unsigned() && counts.size() < 100) counts[{reason, ""}] = count.get<std::uint64_t>();
  return counts;
}

void Collection(const std::vector<DatasetMetrics>& datasets, Exposition& out) {
  out.Family("etude_demonstrations_total", "counter", "Committed demonstrations.");
  for (const auto& dataset : datasets)
    out.Sample("etude_demonstrations_total", {{"campaign", dataset.id}}, static_cast<double>(dataset.state.committed));
  out.Family("etude_demonstrations_wanted", "gauge", "Demonstrations that the campaign asks for.");
  for (const auto& dataset : datasets)
    out.Sample("etude_demonstrations_wanted", {{"campaign", dataset.id}}, static_cast<double>(dataset.state.total));
  out.Family("etude_workers", "gauge", "Workers of a campaign that are heard.");
  for (const auto& dataset : datasets)
    out.Sample("etude_workers", {{"campaign", dataset.id}}, static_cast<double>(dataset.state.workers));
  out.Family("etude_failed_attempts_total", "counter", "Failed attempts by typed reason and task.");
  for (const auto& dataset : datasets)
    for (const auto& [key, count] : FailedAttempts(dataset))
      out.Sample("etude_failed_attempts_total", {{"campaign", dataset.id}, {"reason", key.first}, {"task", key.second}},
                 static_cast<double>(count));
}

// By host: a label each would grow without end. A worker that goes from shard to shard is one slot.
void Slots(const live::LiveView& live, Exposition& out) {
  struct Names {
    std::set<std::string> all, busy;
  };
  const auto now = MonotonicClock::now();
  std::map<std::string, Names> hosts;
  for (const auto& [id, campaign] : live.campaigns) {
    if (!campaign.present) continue;
    for (const auto& [name, worker] : campaign.workers) {
      if (worker.Silent(now)) continue;
      Names& host = hosts[worker.status.host];
      host.all.insert(name);
      if (!worker.status.phase.empty() && worker.status.phase != "idle") host.busy.insert(name);
    }
  }
  out.Family("etude_slots", "gauge", "Workers of a host that are heard.");
  for (const auto& [host, names] : hosts)
    out.Sample("etude_slots", {{"host", host}}, static_cast<double>(names.all.size()));
  out.Family("etude_slots_busy", "gauge", "Those of them that make an episode or send one.");
  for (const auto& [host, names] : hosts)
    out.Sample("etude_slots_busy", {{"host", host}}, static_cast<double>(names.busy.size()));
}

void PlanSeconds(const std::vector<DatasetMetrics>& datasets, Exposition& out) {
  static constexpr std::array<double, 11> kEdges{0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.28, 2.56, 5.12, 10.24};
  const std::string name = "etude_plan_seconds";
  out.Family(name.c_str(), "histogram", "Planning time of an attempt.");
  for (const auto& [id, view, state, heard] : datasets) {
    if (!view) continue;  // its collector does not say how long each took
    std::vector<double> plans;
    for (const auto& row : view->failures)
      if (row.plan_s) plans.push_back(*row.plan_s);
    for (const auto& row : view->rows)
      if (row.plan_s) plans.push_back(*row.plan_s);
    double sum = 0;
    for (const double plan : plans) sum += plan;
    const auto within = [&](double edge) {
      return static_cast<double>(std::ranges::count_if(plans, [&](double plan) { return plan <= edge; }));
    };
    for (const double edge : kEdges)
      out.Sample(name + "_bucket", {{"campaign", id}, {"le", fmt::format("{}", edge)}}, within(edge));
    out.Sample(name + "_bucket", {{"campaign", id}, {"le", "+Inf"}}, static_cast<double>(plans.size()));
    out.Sample(name + "_sum", {{"campaign", id}}, sum);
    out.Sample(name + "_count", {{"campaign", id}}, static_cast<double>(plans.size()));
  }
}

void Training(const std::vector<RunMetrics>& runs, Exposition& out) {
  const auto gauge = [&](const char* name, const char* help, auto value) {
    out.Family(name, "gauge", help);
    for (const auto& run : runs)
      if (const std::optional<double> number = value(run)) out.Sample(name, {{"run", run.id}}, *number);
  };
  gauge("etude_train_step", "Training step.",
        [](const RunMetrics& run) -> std::optional<double> { return static_cast<double>(run.state.step); });
  gauge("etude_train_stage", "Stage of the curriculum, from 1.",
        [](const RunMetrics& run) -> std::optional<double> { return static_cast<double>(run.state.stage); });
  gauge("etude_train_loss", "Loss of training.", [](const RunMetrics& run) { return run.state.loss; });
  gauge("etude_train_samples_per_second", "Samples trained a second.",
        [](const RunMetrics& run) { return run.state.samples_per_s; });
  gauge("etude_train_data_wait_ratio", "Share of a step that waits for data.",
        [](const RunMetrics& run) { return run.state.data_wait; });
  out.Family("etude_checkpoint_step", "gauge", "Step of the checkpoint of a channel.");
  for (const auto& run : runs) {
    if (!run.view) continue;
    for (const auto& header : run.view->checkpoints)
      for (const auto& channel : header.channels)
        if (const auto step = header.metadata.find("step"); step != header.metadata.end())
          out.Sample("etude_checkpoint_step", {{"run", run.id}, {"channel", channel}},
                     std::strtod(step->second.c_str(), nullptr));
  }
}

// By run and host: several servers of a run on a host are one series.
void Policies(const live::LiveView& live, Counters& counters, Counters::TimePoint now, Exposition& out) {
  using Servers = std::vector<const live::LiveServer*>;
  std::map<Counters::Key, Servers> groups;
  for (const auto* server : ServersOf(live))
    groups[{server->status.run + "@" + server->status.run_id, server->status.host}].push_back(server);
  const auto each = [&](const char* name, const char* help, auto join, auto value) {
    out.Family(name, "gauge", help);
    for (const auto& [key, servers] : groups) {
      std::optional<double> joined;
      for (const auto* server : servers)
        if (const std::optional<double> number = value(*server)) joined = joined ? join(*joined, *number) : *number;
      if (joined) out.Sample(name, {{"run", key.first}, {"host", key.second}}, *joined);
    }
  };
  const auto count = [&](const char* name, const char* help, std::uint64_t bus::PolicyStatus::*value) {
    out.Family(name, "counter", help);
    for (const auto& [key, servers] : groups)
      for (const auto* server : servers)
        counters.Saw(name, key, server->status.server, static_cast<double>(server->status.*value), now);
    for (const auto& [key, sum] : counters.Sums(name))
      out.Sample(name, {{"run", key.first}, {"host", key.second}}, sum);
  };
  const auto sum = [](double a, double b) { return a + b; };
  const auto largest = [](double a, double b) { return std::max(a, b); };
  out.Family("etude_policy_servers", "gauge", "Policy servers on the bus.");
  out.Sample("etude_policy_servers", {}, static_cast<double>(live.policies.size()));
  using Number = std::optional<double>;
  each("etude_policy_step", "Step of the checkpoint that is served; the newest of several servers.", largest,
       [](const live::LiveServer& server) -> Number { return static_cast<double>(server.status.step); });
  count("etude_policy_answers_total", "Observations answered.", &bus::PolicyStatus::answered);
  count("etude_policy_refusals_total", "Checkpoints and observations refused.", &bus::PolicyStatus::refused);
  each("etude_policy_answers_per_second", "Observations answered a second, over ten seconds.", sum,
       [](const live::LiveServer& server) { return server.AnswersPerSecond(); });
  each("etude_policy_sessions", "Sessions that asked within ten seconds.", sum,
       [](const live::LiveServer& server) -> Number { return server.status.sessions; });
  each("etude_policy_p50_seconds", "Median time from observation to action, of the slowest server.", largest,
       [](const live::LiveServer& server) -> Number { return server.status.p50_ms / 1000; });
  each("etude_policy_p95_seconds", "95 % of answers take no longer, of the slowest server.", largest,
       [](const live::LiveServer& server) -> Number { return server.status.p95_ms / 1000; });
}

// By host and role: several of a role on a host are added up, a label each would grow without end.
void Processes(const live::LiveView& live, Counters& counters, Counters::TimePoint now, Exposition& out) {
  struct Sum {
    double rss = 0, cpu = 0, count = 0;
  };
  std::map<std::pair<std::string, std::string>, Sum> sums;
  for (const auto& [process, heard] : live.processes) {
    const auto& status = heard.message;
    Sum& sum = sums[{status.host, status.role}];
    sum.rss += static_cast<double>(status.rss_bytes), sum.cpu += status.cpu, sum.count += 1;
    for (const auto& [topic, count] : monitor::Written(status)) {
      counters.Saw("etude_bus_bytes_total", {status.host, topic}, process, count.bytes, now);
      counters.Saw("etude_bus_samples_total", {status.host, topic}, process, count.samples, now);
    }
  }
  const auto each = [&](const char* name, const char* help, double Sum::*value) {
    out.Family(name, "gauge", help);
    for (const auto& [key, sum] : sums) out.Sample(name, {{"host", key.first}, {"role", key.second}}, sum.*value);
  };
  each("etude_processes", "Processes that are heard.", &Sum::count);
  each("etude_process_resident_bytes", "Their resident memory.", &Sum::rss);
  each("etude_process_cpu_cores", "Cores that they use.", &Sum::cpu);
  const auto bus = [&](const char* name, const char* help) {
    out.Family(name, "counter", help);
    for (const auto& [key, sum] : counters.Sums(name))
      out.Sample(name, {{"host", key.first}, {"topic", key.second}}, sum);
  };
  bus("etude_bus_bytes_total", "Bytes written to a topic.");
  bus("etude_bus_samples_total", "Messages written to a topic.");
}

std::string Exposed(const std::vector<DatasetMetrics>& datasets, const std::vector<RunMetrics>& runs,
                    const live::LiveView& live, Counters& counters) {
  const auto now = MonotonicClock::now();
  Exposition out;
  Collection(datasets, out);
  Slots(live, out);
  PlanSeconds(datasets, out);
  Training(runs, out);
  Policies(live, counters, now, out);
  Processes(live, counters, now, out);
  counters.Forget(now);
  return out.Take();
}

constexpr std::size_t kMostOfKind = 40;

// Identities of all datasets of rollouts that are here, however old.
std::set<std::string> RolloutsHere(Context& context) {
  std::set<std::string> identities;
  const auto all = context.sources.catalog().List();  // what is shared must outlive the loop
  for (const auto& found : *all) {
    if (found.kind != sources::Kind::kDataset || found.eval.empty()) continue;
    if (std::string id = context.sources.identities().Of(found.folder); !id.empty()) identities.insert(std::move(id));
  }
  return identities;
}

// Of demonstrations, with what is on the bus alone.
std::vector<DatasetMetrics> DatasetsNow(Context& context, const live::LiveView& live) {
  std::vector<DatasetMetrics> datasets;
  std::set<std::string> known = live.campaigns.empty() ? std::set<std::string>() : RolloutsHere(context);
  for (const auto& found : context.sources.catalog().Demonstrations(kMostOfKind)) {
    const auto opened = OpenDataset(context, found.id);
    if (!opened) continue;
    known.insert(opened->view->info.identity);
    datasets.push_back({found.id, opened->view, StateOf(opened->view.get(), LiveOf(live, *opened->view)), ""});
  }
  for (const auto& [identity, campaign] : live.campaigns)
    if (campaign.present && !known.contains(identity) && !AnnouncesRollouts(campaign))
      datasets.push_back({BusId(campaign.presence), nullptr, StateOf(nullptr, &campaign),
                          campaign.status ? campaign.status->failures_json : ""});
  return datasets;
}

std::vector<RunMetrics> RunsNow(Context& context, const live::LiveView& live) {
  std::vector<RunMetrics> runs;
  std::set<std::string> known;
  for (const auto& found : context.sources.catalog().NewestOf(sources::Kind::kRun, kMostOfKind).found) {
    const auto opened = OpenRun(context, found.id);
    if (!opened) continue;
    known.insert(opened->view->identity);
    runs.push_back({found.id, opened->view, StateOf(opened->view.get(), LiveOf(live, *opened->view))});
  }
  for (const auto& [identity, run] : live.runs)
    if (run.present && !known.contains(identity))
      runs.push_back({BusId(run.presence), nullptr, StateOf(nullptr, &run)});
  return runs;
}

std::string Text(Context& context, Counters& counters) {
  const auto live = context.live();
  return Exposed(DatasetsNow(context, *live), RunsNow(context, *live), *live, counters);
}

}  // namespace

std::string MetricFamilies() {
  std::string families;
  Counters none;
  std::istringstream all(Exposed({}, {}, {}, none));
  for (std::string line; std::getline(all, line);)
    if (line.starts_with('#')) families += line + "\n";
  return families;
}

void AddMetricsRoutes(http::Router& router, Context& context) {
  const auto counters = std::make_shared<Counters>();
  router.Add("GET", "/metrics", http::Lane::kFiles, [&context, counters](const http::Request&) -> Result<http::Answer> {
    return http::BytesAnswer(Text(context, *counters), "text/plain; version=0.0.4; charset=utf-8",
                             http::Caching::kNever);
  });
}

}  // namespace etude::api
