// SPDX-License-Identifier: Apache-2.0
#include "trainer/curriculum/scheduler.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "services/core/check.h"
#include "services/core/enum_name.h"

namespace etude::curriculum {
namespace {

// nullopt: not converged; else why
std::optional<std::string> WhyConverged(const std::string& module, const std::vector<double>& errors,
                                        const CurriculumConfig& config) {
  const auto patience = static_cast<std::ptrdiff_t>(config.patience);
  if (static_cast<std::ptrdiff_t>(errors.size()) <= patience) return std::nullopt;
  const double before = *std::min_element(errors.begin(), errors.end() - patience);
  const double recent = *std::min_element(errors.end() - patience, errors.end());
  if (recent < before * (1 - config.improvement)) return std::nullopt;
  const double gain = before > 0 ? 100 * (before - recent) / before : 0;
  return fmt::format("{} {:.4g}: improved by {:.0f} % in {} evaluations", module, errors.back(), gain, config.patience);
}

std::optional<std::string> WhyGoodEnough(const std::string& module, const std::vector<double>& errors,
                                         const CurriculumConfig& config) {
  const auto goal = config.goals.find(module);
  if (goal == config.goals.end() || errors.empty() || errors.back() > goal->second) return std::nullopt;
  return fmt::format("{} {:.4g}: goal {:.4g} reached", module, errors.back(), goal->second);
}

}  // namespace

void CurriculumConfig::Check(std::vector<std::string>& errors) const {
  if (!(improvement >= 0 && improvement < 1))
    errors.push_back(fmt::format("curriculum.improvement: {} not in 0..1", improvement));
  if (patience < 1) errors.push_back(fmt::format("curriculum.patience: {} must be >= 1", patience));
  if (!(latest_last >= 0 && latest_last <= 1))
    errors.push_back(fmt::format("curriculum.latest_last: {} not in 0..1", latest_last));
  const std::vector<std::string> choices{"always", "before_last", "never"};
  if (std::ranges::find(choices, relabelled) == choices.end())
    errors.push_back(fmt::format("curriculum.relabelled: {}", NotKnown(relabelled, choices)));
}

std::string Subtask::Name() const { return fmt::format("{}", fmt::join(modules, "+")); }

std::string_view ToString(Cause cause) {
  return EnumName(cause, {{Cause::kGoal, "goal"}, {Cause::kConverged, "plateau"}, {Cause::kBudget, "budget"}});
}

Scheduler::Scheduler(const CurriculumConfig& config, std::vector<Subtask> subtasks)
    : config_(config), subtasks_(std::move(subtasks)) {
  ETUDE_CHECK(!subtasks_.empty());
  for (std::size_t i = 1; i < subtasks_.size(); ++i) ETUDE_CHECK(subtasks_[i - 1].level < subtasks_[i].level);
  if (!config_.enabled) stage_ = stages();
}

void Scheduler::StartAt(int level) {
  ETUDE_CHECK(history_.empty() && advances_.empty());
  const auto subtask =
      std::find_if(subtasks_.begin(), subtasks_.end(), [&](const auto& s) { return s.level == level; });
  ETUDE_CHECK(subtask != subtasks_.end(), "level={}", level);
  if (config_.enabled) stage_ = static_cast<int>(subtask - subtasks_.begin()) + 1;
}

bool Scheduler::RelabelledAt(int level) const {
  if (config_.relabelled == "before_last") return level < subtasks_.back().level;
  return config_.relabelled == "always";
}

double Scheduler::Budget() const { return config_.latest_last * stage_ / std::max(1, stages() - 1); }

Advance Scheduler::Go(std::uint64_t step, Cause cause, std::string reason) {
  advances_.push_back({stage_, stage_ + 1, step, cause, std::move(reason)});
  ++stage_;
  history_.clear();
  unmeasured_.clear();
  return advances_.back();
}

std::optional<Advance> Scheduler::Tick(std::uint64_t step, double progress) {
  if (stage_ == stages() || !(progress >= Budget())) return std::nullopt;
  std::vector<std::string> errors;
  for (const auto& [module, history] : history_)
    if (!history.empty()) errors.push_back(fmt::format("{} {:.4g}", module, history.back()));
  for (const auto& module : unmeasured_) errors.push_back(module + " has no measured error");
  return Go(step, Cause::kBudget,
            fmt::format("{:.0f} % of the run are over{}{}", 100 * progress, errors.empty() ? "" : "; ",
                        fmt::join(errors, ", ")));
}

std::optional<Advance> Scheduler::Observe(std::uint64_t step, double progress,
                                          const std::map<std::string, double>& errors) {
  if (stage_ == stages()) return std::nullopt;
  bool all_done = true, all_good = true;
  unmeasured_.clear();
  std::vector<std::string> reasons;
  for (const auto& module : subtasks_[static_cast<std::size_t>(stage_ - 1)].modules) {
    const auto error = errors.find(module);
    if (error == errors.end() || !std::isfinite(error->second)) {
      unmeasured_.insert(module);
      all_done = false;
      continue;
    }
    auto& history = history_[module];
    history.push_back(error->second);
    auto reason = WhyGoodEnough(module, history, config_);
    if (!reason) {
      all_good = false;
      reason = WhyConverged(module, history, config_);
    }
    if (reason)
      reasons.push_back(std::move(*reason));
    else
      all_done = false;
  }
  if (all_done)
    return Go(step, all_good ? Cause::kGoal : Cause::kConverged, fmt::format("{}", fmt::join(reasons, ", ")));
  return Tick(step, progress);
}

bool Scheduler::NewlyUnmeasured() {
  if (unmeasured_.empty() || said_stage_ == stage_) return false;
  said_stage_ = stage_;
  return true;
}

OrderedJson Scheduler::Save() const {
  OrderedJson json;
  json["stage"] = stage_;
  json["stages"] = stages();
  json["history"] = history_;
  json["advances"] = OrderedJson::array();
  for (const auto& a : advances_)
    json["advances"].push_back(
        {{"from", a.from}, {"to", a.to}, {"step", a.step}, {"cause", ToString(a.cause)}, {"reason", a.reason}});
  return json;
}

Status Scheduler::Restore(const OrderedJson& state) {
  try {
    if (state.at("stages").get<int>() != stages())
      return Fail(Code::kCorrupt, fmt::format("curriculum state has {} stages, the policy {}",
                                              state.at("stages").get<int>(), stages()));
    const int stage = state.at("stage").get<int>();
    if (stage < 1 || stage > stages()) return Fail(Code::kCorrupt, fmt::format("curriculum stage {}", stage));
    auto history = state.at("history").get<std::map<std::string, std::vector<double>>>();
    std::vector<Advance> advances;
    for (const auto& item : state.at("advances")) {
      Advance a{item.at("from"), item.at("to"), item.at("step"), Cause::kConverged, item.at("reason")};
      for (const Cause cause : {Cause::kGoal, Cause::kConverged, Cause::kBudget})
        if (item.at("cause").get<std::string>() == ToString(cause)) a.cause = cause;
      advances.push_back(std::move(a));
    }
    stage_ = config_.enabled ? stage : stages();  // it may have been switched off since
    history_ = std::move(history);
    advances_ = std::move(advances);
    return {};
  } catch (const nlohmann::json::exception& error) {
    return Fail(Code::kCorrupt, fmt::format("curriculum state: {}", error.what()));
  }
}

}  // namespace etude::curriculum
