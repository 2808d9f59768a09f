// SPDX-License-Identifier: Apache-2.0
// GET /metrics: what Grafana and alerts read, in Prometheus' text format. Labels are names of campaigns, runs, tasks,
// reasons, hosts, roles and topics only: one a worker would grow without end.
#include "dashboard/server/api/metrics.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <sstream>

#include "dashboard/server/api/context.h"

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

struct Dataset {
  std::string id;
  std::shared_ptr<const sources::DatasetView> view;
  CampaignState state;
};
struct Run {
  std::string id;
  std::shared_ptr<const sources::RunView> view;
  RunState state;
};

void Collection(const std::vector<Dataset>& datasets, Exposition& out) {
  out.Family("etude_demonstrations_total", "counter", "Committed demonstrations.");
  for (const auto& [id, view, state] : datasets)
    out.Sample("etude_demonstrations_total", {{"campaign", id}}, static_cast<double>(state.committed));
  out.Family("etude_demonstrations_wanted", "gauge", "Demonstrations that the campaign asks for.");
  for (const auto& [id, view, state] : datasets)
    out.Sample("etude_demonstrations_wanted", {{"campaign", id}}, static_cast<double>(state.total));
  out.Family("etude_workers", "gauge", "Workers of a campaign that are heard.");
  for (const auto& [id, view, state] : datasets)
    out.Sample("etude_workers", {{"campaign", id}}, static_cast<double>(state.workers));
  out.Family("etude_failed_attempts_total", "counter", "Failed attempts by typed reason and task.");
  for (const auto& [id, view, state] : datasets) {
    std::map<std::pair<std::string, std::string>, std::uint64_t> counts;
    for (const auto& row : view->failures) ++counts[{row.outcome, row.task}];
    for (const auto& [key, count] : counts)
      out.Sample("etude_failed_attempts_total", {{"campaign", id}, {"reason", key.first}, {"task", key.second}},
                 static_cast<double>(count));
  }
}

void PlanSeconds(const std::vector<Dataset>& datasets, Exposition& out) {
  static constexpr std::array<double, 11> kEdges{0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.28, 2.56, 5.12, 10.24};
  const std::string name = "etude_plan_seconds";
  out.Family(name.c_str(), "histogram", "Planning time of an attempt.");
  for (const auto& [id, view, state] : datasets) {
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

void Training(const std::vector<Run>& runs, Exposition& out) {
  const auto gauge = [&](const char* name, const char* help, auto value) {
    out.Family(name, "gauge", help);
    for (const auto& run : runs)
      if (const std::optional<double> number = value(run)) out.Sample(name, {{"run", run.id}}, *number);
  };
  gauge("etude_train_step", "Training step.",
        [](const Run& run) -> std::optional<double> { return static_cast<double>(run.state.step); });
  gauge("etude_train_stage", "Stage of the curriculum, from 1.",
        [](const Run& run) -> std::optional<double> { return static_cast<double>(run.state.stage); });
  gauge("etude_train_loss", "Loss of training.", [](const Run& run) { return run.state.loss; });
  gauge("etude_train_samples_per_second", "Samples trained a second.",
        [](const Run& run) { return run.state.samples_per_s; });
  gauge("etude_train_data_wait_ratio", "Share of a step that waits for data.",
        [](const Run& run) { return run.state.data_wait; });
  out.Family("etude_checkpoint_step", "gauge", "Step of the checkpoint of a channel.");
  for (const auto& run : runs)
    for (const auto& header : run.view->checkpoints)
      for (const auto& channel : header.channels)
        if (const auto step = header.metadata.find("step"); step != header.metadata.end())
          out.Sample("etude_checkpoint_step", {{"run", run.id}, {"channel", channel}},
                     std::strtod(step->second.c_str(), nullptr));
}

void Policies(const live::LiveView& live, Exposition& out) {
  const auto each = [&](const char* name, const char* type, const char* help, auto value) {
    out.Family(name, type, help);
    for (const auto* server : ServersOf(live)) {
      const auto& status = server->status;
      const std::optional<double> number = value(*server);
      if (number) out.Sample(name, {{"run", status.run + "@" + status.run_id}, {"host", status.host}}, *number);
    }
  };
  out.Family("etude_policy_servers", "gauge", "Policy servers on the bus.");
  out.Sample("etude_policy_servers", {}, static_cast<double>(live.policies.size()));
  using Number = std::optional<double>;
  each("etude_policy_step", "gauge", "Step of the checkpoint that is served.",
       [](const live::LiveServer& server) -> Number { return static_cast<double>(server.status.step); });
  each("etude_policy_answers_total", "counter", "Observations answered.",
       [](const live::LiveServer& server) -> Number { return static_cast<double>(server.status.answered); });
  each("etude_policy_refusals_total", "counter", "Checkpoints and observations refused.",
       [](const live::LiveServer& server) -> Number { return static_cast<double>(server.status.refused); });
  each("etude_policy_answers_per_second", "gauge", "Observations answered a second, over ten seconds.",
       [](const live::LiveServer& server) { return server.AnswersPerSecond(); });
  each("etude_policy_sessions", "gauge", "Sessions that asked within ten seconds.",
       [](const live::LiveServer& server) -> Number { return server.status.sessions; });
  each("etude_policy_p50_seconds", "gauge", "Median time from observation to action.",
       [](const live::LiveServer& server) -> Number { return server.status.p50_ms / 1000; });
  each("etude_policy_p95_seconds", "gauge", "95 % of answers take no longer.",
       [](const live::LiveServer& server) -> Number { return server.status.p95_ms / 1000; });
}

// By host and role: several of a role on a host are added up, a label each would grow without end.
void Processes(const live::LiveView& live, Exposition& out) {
  struct Sum {
    double rss = 0, cpu = 0, count = 0;
  };
  std::map<std::pair<std::string, std::string>, Sum> sums;
  std::map<std::pair<std::string, std::string>, monitor::TopicCount> topics;  // by host, topic
  for (const auto& [process, heard] : live.processes) {
    const auto& status = heard.message;
    Sum& sum = sums[{status.host, status.role}];
    sum.rss += static_cast<double>(status.rss_bytes), sum.cpu += status.cpu, sum.count += 1;
    for (const auto& [topic, count] : monitor::Written(status)) {
      auto& total = topics[{status.host, topic}];
      total.samples += count.samples, total.bytes += count.bytes;
    }
  }
  const auto each = [&](const char* name, const char* help, double Sum::*value) {
    out.Family(name, "gauge", help);
    for (const auto& [key, sum] : sums) out.Sample(name, {{"host", key.first}, {"role", key.second}}, sum.*value);
  };
  each("etude_processes", "Processes that are heard.", &Sum::count);
  each("etude_process_resident_bytes", "Their resident memory.", &Sum::rss);
  each("etude_process_cpu_cores", "Cores that they use.", &Sum::cpu);
  const auto bus = [&](const char* name, const char* help, double monitor::TopicCount::*value) {
    out.Family(name, "counter", help);
    for (const auto& [key, count] : topics)
      out.Sample(name, {{"host", key.first}, {"topic", key.second}}, count.*value);
  };
  bus("etude_bus_bytes_total", "Bytes written to a topic by the processes that are there now.",
      &monitor::TopicCount::bytes);
  bus("etude_bus_samples_total", "Messages written to a topic by the processes that are there now.",
      &monitor::TopicCount::samples);
}

std::string Exposed(const std::vector<Dataset>& datasets, const std::vector<Run>& runs, const live::LiveView& live) {
  Exposition out;
  Collection(datasets, out);
  PlanSeconds(datasets, out);
  Training(runs, out);
  Policies(live, out);
  Processes(live, out);
  return out.Take();
}

std::string Text(Context& context) {
  const auto live = context.live();
  std::vector<Dataset> datasets;
  std::vector<Run> runs;
  constexpr std::size_t kMost = 40;
  for (const auto& found : *context.sources.catalog().List()) {
    if (found.kind == sources::Kind::kDataset && found.eval.empty() && datasets.size() < kMost) {
      const auto opened = OpenDataset(context, found.id);
      if (opened)
        datasets.push_back({found.id, opened->view, StateOf(opened->view.get(), LiveOf(*live, *opened->view))});
    }
    if (found.kind == sources::Kind::kRun && runs.size() < kMost) {
      const auto opened = OpenRun(context, found.id);
      if (opened) runs.push_back({found.id, opened->view, StateOf(opened->view.get(), LiveOf(*live, *opened->view))});
    }
  }
  return Exposed(datasets, runs, *live);
}

}  // namespace

std::string MetricFamilies() {
  std::string families;
  std::istringstream all(Exposed({}, {}, {}));
  for (std::string line; std::getline(all, line);)
    if (line.starts_with('#')) families += line + "\n";
  return families;
}

void AddMetricsRoutes(http::Router& router, Context& context) {
  router.Add("GET", "/metrics", http::Lane::kFiles, [&context](const http::Request&) -> Result<http::Answer> {
    return http::BytesAnswer(Text(context), "text/plain; version=0.0.4; charset=utf-8", http::Caching::kNever);
  });
}

}  // namespace etude::api
