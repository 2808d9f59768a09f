// SPDX-License-Identifier: Apache-2.0
#include "services/cli/results_config.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <iterator>
#include <map>
#include <set>

#include "services/cli/results_record.h"

namespace etude::cli {
namespace {

// What a row lacks to be trained, or has too much to be an evaluation of another row's runs.
std::vector<std::string> ErrorsOf(const ResultRow& row, const std::set<std::string>& before) {
  std::vector<std::string> errors;
  const auto check = [&](bool good, std::string what) {
    if (!good) errors.push_back(fmt::format("{}: {}", row.name, what));
  };
  const ResultTraining& train = row.train;
  const bool trains = train.runs_of.empty(), begins = !train.init.empty();
  check(IsPlainName(row.name), fmt::format("'{}' is not a plain name", row.name));
  check(!train.seeds.empty(), "train.seeds: needs one");
  check(trains != row.data.campaign.empty(), trains ? "data.campaign: missing" : "data: not with train.runs_of");
  check(trains == (train.minutes > 0 || train.steps > 0),
        trains ? "train: needs minutes or steps" : "train: minutes or steps are not with runs_of");
  check(trains || before.contains(train.runs_of),
        fmt::format("train.runs_of: '{}' is no row before it", train.runs_of));
  check(trains || !begins, "train.init: not with runs_of");
  check(!begins || before.contains(train.init), fmt::format("train.init: '{}' is no row before it", train.init));
  check(!begins || train.config == ResultTraining().config,
        "train.config: not with init, whose checkpoint has the graph");
  check(row.data.name.empty() || IsPlainName(row.data.name),
        fmt::format("data.name: '{}' is not a plain name", row.data.name));
  check(row.compare.empty() || before.contains(row.compare),
        fmt::format("compare: '{}' is no row before it", row.compare));
  check(row.eval.sentences.empty() || row.eval.tasks.empty(), "eval.tasks: not with sentences, which say them");
  return errors;
}

std::vector<std::string> GoalErrors(const ResultRow& row) {
  std::vector<std::string> errors;
  const auto check = [&](bool good, const std::string& key, const char* what) {
    if (!good) errors.push_back(fmt::format("{}: goals.{}: {}", row.name, key, what));
  };
  for (const auto& [key, value] : row.goals) {
    const bool known = key == kGoalLatched || key == kGoalDrop || key == kGoalBetter || key == kGoalMinutes;
    const bool module = !key.empty() && std::ranges::all_of(key, [](char letter) {
      return (letter >= 'A' && letter <= 'Z') || (letter >= '0' && letter <= '9') || letter == '_';
    });
    check(known || module, key, "neither latched, drop, p or minutes nor the name of a module");
    check(value > 0, key, "must be > 0");
    check((key != kGoalDrop && key != kGoalBetter) || !row.compare.empty(), key, "needs compare");
    check(key != kGoalBetter || value < 1, key, "must be < 1");
    check(key != kGoalMinutes || row.train.runs_of.empty(), key, "not with train.runs_of");
  }
  return errors;
}

bool AreOneDataset(const ResultData& first, const ResultData& second) {
  return first.campaign == second.campaign && first.episodes == second.episodes && first.set == second.set;
}

}  // namespace

Status ResultsConfig::Validate() const {
  std::vector<std::string> errors;
  std::set<std::string> names;
  std::map<std::string, const ResultRow*> datasets;
  for (const auto& row : rows) {
    std::ranges::move(ErrorsOf(row, names), std::back_inserter(errors));
    std::ranges::move(GoalErrors(row), std::back_inserter(errors));
    // they share what the first of them collects
    const auto first = row.data.campaign.empty() ? datasets.end() : datasets.try_emplace(DatasetName(row), &row).first;
    if (first != datasets.end() && !AreOneDataset(row.data, first->second->data))
      errors.push_back(fmt::format("{}: data: '{}' is collected for {} with another campaign, episodes or set",
                                   row.name, first->first, first->second->name));
    const auto other = std::ranges::find(rows, row.compare, &ResultRow::name);
    for (const auto seed : row.train.seeds)
      if (other != rows.end() && std::ranges::find(other->train.seeds, seed) == other->train.seeds.end())
        errors.push_back(fmt::format("{}: compare: '{}' has no seed {}", row.name, row.compare, seed));
    const bool begins = !row.train.init.empty();
    const std::string& first_row = begins ? row.train.init : row.train.runs_of;
    const auto trained = std::ranges::find(rows, first_row, &ResultRow::name);
    if (trained != rows.end() && !trained->train.runs_of.empty())
      errors.push_back(
          fmt::format("{}: train.{}: '{}' has no runs of its own", row.name, begins ? "init" : "runs_of", first_row));
    for (const auto seed : row.train.seeds)
      if (!begins && trained != rows.end() &&
          std::ranges::find(trained->train.seeds, seed) == trained->train.seeds.end())
        errors.push_back(fmt::format("{}: train.runs_of: '{}' has no seed {}", row.name, first_row, seed));
    if (!names.insert(row.name).second) errors.push_back(fmt::format("rows: '{}' stands twice", row.name));
  }
  if (errors.empty()) return {};
  return Fail(Code::kInvalidArgument, fmt::format("results: {}", fmt::join(errors, "; ")));
}

Result<ResultsConfig> LoadResults(const Path& file) {
  ETUDE_ASSIGN_OR_RETURN(auto config, LoadConfig<ResultsConfig>(file));
  ETUDE_RETURN_IF_ERROR(config.Validate());
  for (auto& row : config.rows) {
    const std::string& first = row.train.init.empty() ? row.train.runs_of : row.train.init;
    if (!first.empty()) row.begins_with = DefinitionOf(*std::ranges::find(config.rows, first, &ResultRow::name));
  }
  return config;
}

}  // namespace etude::cli
