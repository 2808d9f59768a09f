// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/eval_comparison.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "services/core/statistics.h"
#include "services/episode/bounded_json.h"
#include "services/store/dataset.h"

namespace etude::campaign {
namespace {

// One rollout of a report.
struct PairRow {
  std::uint64_t seed = 0;
  std::string task, target;
  bool success = false, latched = false;
};
using PairRows = std::map<std::uint64_t, PairRow>;

Result<PairRow> RowFrom(const OrderedJson& json) {
  const auto has = [&](const char* key, auto is) { return json.contains(key) && (json[key].*is)(); };
  using J = OrderedJson;
  if (!json.is_object() || !has("index", &J::is_number_unsigned) || !has("seed", &J::is_number_unsigned) ||
      !has("task", &J::is_string) || !has("target", &J::is_string) || !has("success", &J::is_boolean) ||
      !has("success_latched", &J::is_boolean))
    return Fail(Code::kCorrupt, "compare: a rollout of a report lacks its index, seed, task, target or success");
  return PairRow{json["seed"].get<std::uint64_t>(), json["task"].get<std::string>(), json["target"].get<std::string>(),
                 json["success"].get<bool>(), json["success_latched"].get<bool>()};
}

Result<PairRows> RowsOf(const OrderedJson& report) {
  if (!report.is_object() || !report.contains("per_episode") || !report["per_episode"].is_array())
    return Fail(Code::kCorrupt, "compare: not the report of an evaluation");
  PairRows rows;
  for (const auto& json : report["per_episode"]) {
    ETUDE_ASSIGN_OR_RETURN(PairRow row, RowFrom(json));
    rows[json["index"].get<std::uint64_t>()] = std::move(row);
  }
  return rows;
}

// Rollouts that both have.
using Pairs = std::vector<std::pair<const PairRow*, const PairRow*>>;

Result<Pairs> Paired(const PairRows& first, const PairRows& second) {
  Pairs pairs;
  for (const auto& [index, row] : first) {
    const auto it = second.find(index);
    if (it == second.end()) continue;
    const PairRow& other = it->second;
    if (row.seed != other.seed || row.task != other.task || row.target != other.target)
      return Fail(Code::kInvalidArgument,
                  fmt::format("compare: rollout {} is '{} {}' of seed {} in one and '{} {}' of seed {} in the other: "
                              "only evaluations of the same scenes can be paired",
                              index, row.task, row.target, row.seed, other.task, other.target, other.seed));
    pairs.emplace_back(&row, &other);
  }
  return pairs;
}

OrderedJson Counted(const std::string& task, const Pairs& pairs, bool PairRow::*criterion) {
  PairedCounts counts;
  for (const auto& [first, second] : pairs) {
    if (!task.empty() && first->task != task) continue;
    const bool a = first->*criterion, b = second->*criterion;
    ++(a ? (b ? counts.both : counts.only_first) : (b ? counts.only_second : counts.neither));
  }
  const auto share = [&](std::uint64_t successes) {
    return counts.n() == 0 ? 0.0 : static_cast<double>(successes) / static_cast<double>(counts.n());
  };
  return {{"task", task.empty() ? "overall" : task},
          {"n", counts.n()},
          {"both", counts.both},
          {"only_first", counts.only_first},
          {"only_second", counts.only_second},
          {"neither", counts.neither},
          {"share_first", share(counts.both + counts.only_first)},
          {"share_second", share(counts.both + counts.only_second)},
          {"p", McNemarExactP(counts.only_first, counts.only_second)}};
}

// What no scene depends on.
bool MakesNoScene(const std::string& key) {
  static const std::vector<std::string> keys{"name",         "mode",     "episodes",        "image_stride",
                                             "max_attempts", "split",    "stall_timeout_s", "determinism",
                                             "recheck",      "renderer", "device"};
  return std::ranges::count(keys, key) > 0;
}

void Compare(const OrderedJson& first, const OrderedJson& second, const std::string& prefix,
             std::vector<std::string>& differences) {
  for (const auto& [key, value] : first.items()) {
    const std::string path = prefix + key;
    const OrderedJson now = second.contains(key) ? second[key] : OrderedJson();
    if (MakesNoScene(path) || path == "camera.width" || path == "camera.height") continue;
    if (prefix == "rollout." && key != "sentences") continue;
    if (value.is_object())
      Compare(value, now, path + ".", differences);
    else if (value != now)
      differences.push_back(value.dump().size() + now.dump().size() > 200
                                ? path
                                : fmt::format("{} ({}, now {})", path, value.dump(), now.dump()));
  }
}

// Reports of earlier versions have no spec: it is with the rollouts then.
Result<CampaignSpec> SpecOf(const OrderedJson& report, const Path& folder) {
  if (report.is_object() && report.contains("spec")) return FromJson<CampaignSpec>(report["spec"], "eval.json: spec");
  ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(folder / "rollouts"));
  return reader.spec();
}

std::string RunOf(const OrderedJson& report) {
  return report.contains("run") && report["run"].is_string() ? report["run"].get<std::string>() : "";
}

std::string Line(const OrderedJson& row, const std::string& name) {
  const auto count = [&](const char* key) { return row[key].get<std::uint64_t>(); };
  return fmt::format("{:<18} {:>5} {:>6} {:>10} {:>11} {:>8} {:>8.1f} {:>8.1f} {:>10.4g}\n", name, count("n"),
                     count("both"), count("only_first"), count("only_second"), count("neither"),
                     100 * row["share_first"].get<double>(), 100 * row["share_second"].get<double>(),
                     row["p"].get<double>());
}

}  // namespace

std::vector<std::string> SceneDifferences(const CampaignSpec& first, const CampaignSpec& second) {
  std::vector<std::string> differences;
  Compare(ToJson(first), ToJson(second), "", differences);
  return differences;
}

Status CheckSameScenes(const CampaignSpec& first, const CampaignSpec& second, const std::string& other) {
  const auto differences = SceneDifferences(second, first);
  if (differences.empty()) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("'{}' was evaluated in other scenes; different: {}; rollouts can only be paired in the same",
                          other, fmt::join(differences, ", ")));
}

std::vector<std::string> RuleDifferences(const OrderedJson& first, const OrderedJson& second) {
  if (!first.contains("rules") || !second.contains("rules")) return {};
  std::vector<std::string> differences;
  Compare(first["rules"], second["rules"], "", differences);
  return differences;
}

Status CheckSameRules(const OrderedJson& first, const OrderedJson& second, const std::string& other) {
  const auto differences = RuleDifferences(second, first);
  if (differences.empty()) return {};
  return Fail(
      Code::kInvalidArgument,
      fmt::format("'{}' was evaluated by other rules; different: {}; evaluate both again with one version of Etude "
                  "and of the tasks' files",
                  other, fmt::join(differences, ", ")));
}

Result<OrderedJson> CompareReports(const OrderedJson& first, const OrderedJson& second) {
  ETUDE_ASSIGN_OR_RETURN(const PairRows rows, RowsOf(first));
  ETUDE_ASSIGN_OR_RETURN(const PairRows others, RowsOf(second));
  ETUDE_ASSIGN_OR_RETURN(const Pairs pairs, Paired(rows, others));
  OrderedJson json{{"first", RunOf(first)},
                   {"second", RunOf(second)},
                   {"n", pairs.size()},
                   {"unpaired", rows.size() + others.size() - 2 * pairs.size()}};
  std::vector<std::string> tasks;
  for (const auto& pair : pairs)
    if (std::ranges::count(tasks, pair.first->task) == 0) tasks.push_back(pair.first->task);
  std::ranges::sort(tasks);
  json["per_task"] = OrderedJson::array();
  for (const auto& task : tasks) json["per_task"].push_back(Counted(task, pairs, &PairRow::success));
  json["overall"] = Counted("", pairs, &PairRow::success);
  json["overall_latched"] = Counted("", pairs, &PairRow::latched);
  return json;
}

Result<Evaluation> ReadEvaluation(const Path& folder) {
  const auto wrapped = [&](const Error& error) {
    return Fail(error.Wrap(fmt::format("'{}' is no evaluation of `etude eval`", folder.string())));
  };
  const auto text = ReadTextFile(folder / "eval.json");
  if (!text) return wrapped(text.error());
  auto report = ParseBoundedJson(*text);
  if (!report) return wrapped({Code::kCorrupt, "eval.json is not JSON"});
  auto spec = SpecOf(*report, folder);
  if (!spec) return wrapped(spec.error());
  return Evaluation{std::move(*spec), std::move(*report)};
}

Result<OrderedJson> CompareEvaluations(const Path& first, const Path& second) {
  ETUDE_ASSIGN_OR_RETURN(const Evaluation one, ReadEvaluation(first));
  ETUDE_ASSIGN_OR_RETURN(const Evaluation other, ReadEvaluation(second));
  ETUDE_RETURN_IF_ERROR(CheckSameScenes(one.spec, other.spec, second.string()));
  ETUDE_RETURN_IF_ERROR(CheckSameRules(one.report, other.report, second.string()));
  return CompareReports(one.report, other.report);
}

std::string ComparisonText(const OrderedJson& comparison) {
  std::string text =
      fmt::format("first: {}   second: {}\n{:<18} {:>5} {:>6} {:>10} {:>11} {:>8} {:>8} {:>8} {:>10}\n",
                  comparison["first"].get<std::string>(), comparison["second"].get<std::string>(), "paired", "n",
                  "both", "only first", "only second", "neither", "first %", "second %", "p");
  for (const auto& row : comparison["per_task"]) text += Line(row, row["task"].get<std::string>());
  text += Line(comparison["overall"], "overall") + Line(comparison["overall_latched"], "overall, latched");
  text += "p: exact two-sided McNemar test: how likely a coin splits the rollouts of one alone as unevenly.\n";
  if (const auto unpaired = comparison["unpaired"].get<std::uint64_t>(); unpaired > 0)
    text += fmt::format("left out: {} rollouts that only one of the two has\n", unpaired);
  return text;
}

}  // namespace etude::campaign
