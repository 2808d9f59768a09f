// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/eval_report.h"

#include <fmt/format.h>

#include <cmath>

#include "services/core/statistics.h"

namespace etude::campaign {
namespace {

std::uint64_t UnsignedOr0(const OrderedJson& json, const char* key) {
  return json.contains(key) && json[key].is_number_unsigned() ? json[key].get<std::uint64_t>() : 0;
}

using ErrorMap = std::map<std::string, double>;

// mean over rollouts of their own means, so that a long failure does not outweigh short successes
OrderedJson MeanErrors(const std::vector<const RolloutRow*>& rows, ErrorMap RolloutRow::*errors) {
  OrderedJson json = OrderedJson::object();
  for (const auto& module : kReportedModules) {
    std::vector<double> means;
    for (const auto* row : rows)
      if (const auto it = (row->*errors).find(module); it != (row->*errors).end()) means.push_back(it->second);
    if (!means.empty()) json[module] = Mean(means);
  }
  return json;
}

OrderedJson Summarise(const std::string& task, const std::vector<const RolloutRow*>& rows) {
  std::uint64_t successes = 0;
  for (const auto* row : rows) successes += row->success;
  const auto interval = WilsonInterval(successes, rows.size());
  OrderedJson summary{
      {"task", task},
      {"n", rows.size()},
      {"successes", successes},
      {"success", rows.empty() ? 0.0 : static_cast<double>(successes) / static_cast<double>(rows.size())},
      {"low", interval.low},
      {"high", interval.high}};
  summary["error_cm"] = MeanErrors(rows, &RolloutRow::error_cm);
  summary["error_before_contact_cm"] = MeanErrors(rows, &RolloutRow::error_before_contact_cm);
  return summary;
}

OrderedJson RowJson(const RolloutRow& row) {
  OrderedJson json{{"index", row.index},
                   {"seed", row.seed},
                   {"task", row.task},
                   {"target", row.target},
                   {"instruction", row.instruction},
                   {"success", row.success},
                   {"outcome", row.outcome},
                   {"steps", row.steps},
                   {"decisions", row.decisions},
                   {"checkpoint_step", row.checkpoint_step}};
  json["error_cm"] = row.error_cm;
  json["error_before_contact_cm"] = row.error_before_contact_cm;
  return json;
}

}  // namespace

RolloutRow RowOf(const Episode& rollout) {
  RolloutRow row;
  row.index = rollout.index;
  row.seed = rollout.seed;
  row.task = rollout.task;
  row.target = rollout.target;
  row.instruction = rollout.instruction;
  row.success = rollout.success;
  row.outcome = rollout.outcome;
  row.steps = rollout.steps();
  if (!rollout.details.is_object() || !rollout.details.contains("decisions")) return row;
  std::map<std::string, std::vector<double>> all, before;
  for (const auto& decision : rollout.details["decisions"]) {
    if (!decision.is_object()) continue;
    ++row.decisions;
    row.checkpoint_step = UnsignedOr0(decision, "checkpoint_step");
    const bool touched = decision.contains("touched") && decision["touched"] == true;
    for (const auto& module : kReportedModules) {
      if (!decision.contains(module) || !decision[module].is_number()) continue;
      const double error_cm = 100 * decision[module].get<double>();
      if (!std::isfinite(error_cm)) continue;
      all[module].push_back(error_cm);
      if (!touched) before[module].push_back(error_cm);
    }
  }
  for (const auto& [module, values] : all) row.error_cm[module] = Mean(values);
  for (const auto& [module, values] : before) row.error_before_contact_cm[module] = Mean(values);
  return row;
}

OrderedJson EvalReport(const CampaignSpec& spec, const std::map<std::uint64_t, RolloutRow>& rows) {
  OrderedJson report{{"campaign", spec.name},
                     {"run", spec.rollout.run},
                     {"seed", spec.seed},
                     {"episodes", spec.episodes},
                     {"done", rows.size()}};
  report["per_task"] = OrderedJson::array();
  std::vector<const RolloutRow*> all;
  for (const auto& [index, row] : rows) all.push_back(&row);
  for (const auto& task : spec.tasks) {
    std::vector<const RolloutRow*> of_task;
    for (const auto* row : all)
      if (row->task == task) of_task.push_back(row);
    report["per_task"].push_back(Summarise(task, of_task));
  }
  report["overall"] = Summarise("overall", all);
  report["per_episode"] = OrderedJson::array();
  for (const auto* row : all) report["per_episode"].push_back(RowJson(*row));
  return report;
}

std::string EvalTable(const OrderedJson& report) {
  std::string table = fmt::format("{:<10} {:>4} {:>9} {:>15} {:>9} {:>9} {:>9}\n", "task", "n", "success %",
                                  "95 % interval", "TAR3D cm", "EE3D cm", "DISP cm");
  const auto line = [&](const OrderedJson& summary) {
    table += fmt::format(
        "{:<10} {:>4} {:>9.1f} {:>15}", summary["task"].get<std::string>(), summary["n"].get<std::uint64_t>(),
        100 * summary["success"].get<double>(),
        fmt::format("{:.1f} .. {:.1f}", 100 * summary["low"].get<double>(), 100 * summary["high"].get<double>()));
    for (const auto& module : kReportedModules)
      table += summary["error_cm"].contains(module)
                   ? fmt::format(" {:>9.2f}", summary["error_cm"][module].get<double>())
                   : fmt::format(" {:>9}", "-");
    table += "\n";
  };
  for (const auto& summary : report["per_task"]) line(summary);
  line(report["overall"]);
  return table;
}

}  // namespace etude::campaign
