// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/eval_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "services/campaign/suite_report.h"
#include "services/core/statistics.h"
#include "services/spec/content_version.h"
#include "services/spec/task_name.h"

namespace etude::campaign {
namespace {

const std::vector<std::string> kFirstModules{"TAR3D", "EE3D", "DISP"};  // the paper's, before others

using Rows = std::vector<const RolloutRow*>;
using ErrorMap = std::map<std::string, double>;

std::uint64_t UnsignedOr0(const OrderedJson& json, const char* key) {
  if (!json.contains(key) || !json[key].is_number_integer()) return 0;
  return json[key].is_number_unsigned()
             ? json[key].get<std::uint64_t>()
             : static_cast<std::uint64_t>(std::max<std::int64_t>(0, json[key].get<std::int64_t>()));
}

// mean over rollouts of their own means, so that a long failure does not outweigh short successes
OrderedJson MeanErrors(const Rows& rows, ErrorMap RolloutRow::*errors) {
  std::map<std::string, std::vector<double>> means;
  for (const auto* row : rows)
    for (const auto& [module, mean] : row->*errors) means[module].push_back(mean);
  OrderedJson json = OrderedJson::object();
  for (const auto& module : kFirstModules)
    if (means.contains(module)) json[module] = Mean(means[module]);
  for (const auto& [module, values] : means)
    if (!json.contains(module)) json[module] = Mean(values);
  return json;
}

OrderedJson Share(const Rows& rows, bool RolloutRow::*criterion) {
  const auto n = static_cast<std::uint64_t>(rows.size());
  const auto successes = static_cast<std::uint64_t>(
      std::count_if(rows.begin(), rows.end(), [&](const RolloutRow* row) { return row->*criterion; }));
  return ShareJson(successes, n);
}

OrderedJson Summarize(const std::string& task, const Rows& rows) {
  std::map<std::string, std::uint64_t> violations;
  std::uint64_t violated = 0, disturbed = 0;
  for (const auto* row : rows) {
    for (const auto& kind : row->violations) ++violations[kind];
    violated += row->violations.empty() ? 0 : 1;
    disturbed += row->disturbed.empty() ? 0 : 1;
  }
  OrderedJson summary{{"task", task}, {"n", rows.size()}};
  summary["success"] = Share(rows, &RolloutRow::success);
  summary["success_latched"] = Share(rows, &RolloutRow::success_latched);
  summary["with_violations"] = violated;
  summary["violations"] = violations;
  summary["with_others_moved"] = disturbed;
  summary["error_cm"] = MeanErrors(rows, &RolloutRow::error_cm);
  summary["error_before_contact_cm"] = MeanErrors(rows, &RolloutRow::error_before_contact_cm);
  return summary;
}

OrderedJson PolicyJson(const EvalSubject& subject) {
  return {{"run_id", subject.run_id},
          {"run", subject.run},
          {"sha256", subject.sha256},
          {"step", subject.step},
          {"file", subject.file}};
}

// The setting, and what came of it: rollouts may have found different servers.
OrderedJson Latency(const CampaignSpec& spec, const Rows& rows) {
  OrderedJson json{{"setting_ms", spec.rollout.latency_ms}};
  if (rows.empty()) return json;
  const auto [least, most] = std::ranges::minmax(rows, {}, &RolloutRow::latency_steps);
  json["least_steps"] = least->latency_steps;
  json["most_steps"] = most->latency_steps;
  return json;
}

void ReadJudgement(const OrderedJson& details, RolloutRow& row) {
  row.success_latched = details.contains("success_latched") && details["success_latched"] == true;
  row.latency_steps = static_cast<int>(std::min<std::uint64_t>(UnsignedOr0(details, "latency_steps"), 1'000'000));
  if (details.contains("violations"))
    for (const auto& violation : details["violations"])
      if (violation.is_object() && violation.contains("kind") && violation["kind"].is_string())
        row.violations.insert(violation["kind"].get<std::string>());
  if (details.contains("disturbed_objects"))
    for (const auto& object : details["disturbed_objects"])
      if (object.is_string()) row.disturbed.push_back(object.get<std::string>());
}

void ReadHardships(const OrderedJson& details, RolloutRow& row) {
  if (details.contains("occlusion") && details["occlusion"].is_object() && details["occlusion"].contains("covered")) {
    const OrderedJson& covered = details["occlusion"]["covered"];
    if (covered.is_number() && std::isfinite(covered.get<double>())) row.covered = covered.get<double>();
  }
  if (!details.contains("pushes") || !details["pushes"].is_array()) return;
  row.pushes = static_cast<int>(details["pushes"].size());
  row.pushes_missed = static_cast<int>(std::min<std::uint64_t>(UnsignedOr0(details, "pushes_missed"), 1'000'000));
}

void NoteBad(FirstBad bad, RolloutRow& row) {
  if (bad.error_cm <= kBadDecision_cm) return;
  const auto& first = row.first_bad;
  if (!first || (first->decision == bad.decision && first->error_cm < bad.error_cm)) row.first_bad = std::move(bad);
}

void ReadDecisions(const OrderedJson& decisions, RolloutRow& row) {
  std::map<std::string, std::vector<double>> all, before;
  for (const auto& decision : decisions) {
    if (!decision.is_object()) continue;
    ++row.decisions;
    row.checkpoint_step = UnsignedOr0(decision, "checkpoint_step");
    const bool touched = decision.contains("touched") && decision["touched"] == true;
    if (!decision.contains("error_m") || !decision["error_m"].is_object()) continue;
    for (const auto& [module, error] : decision["error_m"].items()) {
      if (!error.is_number()) continue;
      const double error_cm = 100 * error.get<double>();
      if (!std::isfinite(error_cm)) continue;
      all[module].push_back(error_cm);
      NoteBad({module, row.decisions - 1, UnsignedOr0(decision, "step"), error_cm}, row);
      if (!touched) before[module].push_back(error_cm);
    }
  }
  for (const auto& [module, values] : all) row.error_cm[module] = Mean(values);
  for (const auto& [module, values] : before) row.error_before_contact_cm[module] = Mean(values);
}

std::string TableLine(const OrderedJson& summary, const std::vector<std::string>& modules) {
  std::string line = fmt::format("{:<18} {:>5} {:>20} {:>20} {:>10} {:>7}", summary["task"].get<std::string>(),
                                 summary["n"].get<std::uint64_t>(), ShareText(summary["success"]),
                                 ShareText(summary["success_latched"]), summary["with_violations"].get<std::uint64_t>(),
                                 summary["with_others_moved"].get<std::uint64_t>());
  const auto number = [&](const char* errors, const std::string& module) {
    return summary[errors].contains(module) ? fmt::format("{:.2f}", summary[errors][module].get<double>()) : "-";
  };
  for (const auto& module : modules)
    line += fmt::format(" {:>13}",
                        fmt::format("{} ({})", number("error_cm", module), number("error_before_contact_cm", module)));
  return line + "\n";
}

}  // namespace

OrderedJson ShareJson(std::uint64_t successes, std::uint64_t n) {
  const auto interval = WilsonInterval(successes, n);
  return {{"successes", successes},
          {"share", n == 0 ? 0.0 : static_cast<double>(successes) / static_cast<double>(n)},
          {"low", interval.low},
          {"high", interval.high}};
}

std::string ShareText(const OrderedJson& share) {
  return fmt::format("{:5.1f} [{:.1f}, {:.1f}]", 100 * share["share"].get<double>(), 100 * share["low"].get<double>(),
                     100 * share["high"].get<double>());
}

OrderedJson RowJson(const RolloutRow& row) {
  OrderedJson json{{"index", row.index},
                   {"seed", row.seed},
                   {"robot", row.robot},
                   {"task", row.task},
                   {"target", row.target},
                   {"reference", row.reference},
                   {"instruction", row.instruction},
                   {"success", row.success},
                   {"success_latched", row.success_latched},
                   {"outcome", row.outcome},
                   {"violations", row.violations},
                   {"disturbed_objects", row.disturbed},
                   {"steps", row.steps},
                   {"decisions", row.decisions},
                   {"latency_steps", row.latency_steps},
                   {"checkpoint_step", row.checkpoint_step}};
  json["error_cm"] = row.error_cm;
  json["error_before_contact_cm"] = row.error_before_contact_cm;
  if (const auto& bad = row.first_bad)
    json["first_bad"] = {{"module", bad->module},
                         {"decision", bad->decision},
                         {"step", bad->step},
                         {"error_cm", bad->error_cm},
                         {"over_cm", kBadDecision_cm}};
  if (row.covered) json["covered"] = *row.covered;
  if (row.pushes) json["pushes"] = *row.pushes;
  if (row.pushes) json["pushes_missed"] = row.pushes_missed;
  if (row.wall_s > 0) json["wall_s"] = row.wall_s;
  return json;
}

OrderedJson ReadReport(const Path& evaluation) {
  constexpr std::uintmax_t kMostBytes = 256 << 20;
  const auto text = ReadTextFile(evaluation / "eval.json", kMostBytes);
  return text ? ParseBoundedJson(*text).value_or(OrderedJson()) : OrderedJson();
}

EvalSubject SubjectOf(const OrderedJson& report) {
  EvalSubject subject;
  if (!report.is_object()) return subject;
  const auto text = [](const OrderedJson& json, const char* key) {
    return json.contains(key) && json[key].is_string() ? json[key].get<std::string>() : std::string();
  };
  subject.dataset = text(report, "dataset");
  if (report.contains("created") && report["created"].is_number()) subject.created = report["created"].get<double>();
  if (!report.contains("policy") || !report["policy"].is_object()) return subject;
  const OrderedJson& policy = report["policy"];
  subject.run_id = text(policy, "run_id");
  subject.run = text(policy, "run");
  subject.sha256 = text(policy, "sha256");
  subject.step = UnsignedOr0(policy, "step");
  subject.file = text(policy, "file");
  return subject;
}

std::uint64_t RolloutsOf(const OrderedJson& report) { return report.is_object() ? UnsignedOr0(report, "done") : 0; }

RolloutRow RowOf(const Episode& rollout) {
  RolloutRow row;
  row.index = rollout.index;
  row.seed = rollout.seed;
  row.robot = rollout.robot;
  row.reference = rollout.reference;
  row.task = rollout.task;
  row.target = rollout.target;
  row.instruction = rollout.instruction;
  row.success = rollout.success;
  row.outcome = rollout.outcome;
  row.steps = rollout.steps();
  if (!rollout.details.is_object()) return row;
  ReadJudgement(rollout.details, row);
  ReadHardships(rollout.details, row);
  if (rollout.details.contains("decisions")) ReadDecisions(rollout.details["decisions"], row);
  return row;
}

OrderedJson EvalRules(const CampaignSpec& spec) {
  OrderedJson tasks = OrderedJson::object();
  for (const auto& name : spec.tasks)
    if (const auto task = ParseTask(name)) tasks[name] = task->spec->sha256;
  return {{"tasks", std::move(tasks)}, {"content", kContentVersion}, {"rollout", kRolloutVersion}};
}

OrderedJson EvalReport(const CampaignSpec& spec, const std::map<std::uint64_t, RolloutRow>& rows,
                       const EvalSubject& subject) {
  Rows all;
  for (const auto& [index, row] : rows) all.push_back(&row);
  OrderedJson report{{"campaign", spec.name},      {"run", spec.rollout.run}, {"seed", spec.seed},
                     {"episodes", spec.episodes},  {"done", rows.size()},     {"policy", PolicyJson(subject)},
                     {"dataset", subject.dataset}, {"judge", "strict"},       {"created", subject.created}};
  report["latency"] = Latency(spec, all);
  report["per_task"] = OrderedJson::array();
  for (const auto& task : spec.tasks) {
    Rows of_task;
    for (const auto* row : all)
      if (row->task == task) of_task.push_back(row);
    report["per_task"].push_back(Summarize(task, of_task));
  }
  report["overall"] = Summarize("overall", all);
  AddSuites(spec, rows, report);
  report["spec"] = ToJson(spec);
  report["rules"] = EvalRules(spec);
  report["per_episode"] = OrderedJson::array();
  for (const auto* row : all) report["per_episode"].push_back(RowJson(*row));
  return report;
}

std::string EvalTable(const OrderedJson& report) {
  std::vector<std::string> modules;
  for (const auto& [module, error] : report["overall"]["error_cm"].items()) modules.push_back(module);
  std::string table = fmt::format("{:<18} {:>5} {:>20} {:>20} {:>10} {:>7}", "task", "n", "success % [95 %]",
                                  "latched % [95 %]", "violations", "others");
  for (const auto& module : modules) table += fmt::format(" {:>13}", module + " cm");
  table += "\n";
  for (const auto& summary : report["per_task"]) table += TableLine(summary, modules);
  table += TableLine(report["overall"], modules);
  table +=
      "success: held for 0.4 s, no violation. latched: the authors' criterion, once (a turn counts either way round, "
      "theirs one way); only this column stands beside the paper's figures.\n"
      "violations, others: rollouts with any, with another object moved by more than 2 cm. "
      "cm: mean over rollouts of their mean errors (before the first contact).\n";
  return table;
}

}  // namespace etude::campaign
