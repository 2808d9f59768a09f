// SPDX-License-Identifier: Apache-2.0
// The curriculum: which subtasks are trained now, and why it went on.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/result.h"

namespace etude::curriculum {

struct CurriculumConfig {
  bool enabled = true;  ///< false: every subtask from the start
  /// A module has converged when the best error of the last `patience` evaluations is not better
  /// than the best before them by this fraction.
  double improvement = 0.1;
  int patience = 2;  ///< evaluations, >= 1
  /// The last subtask starts at the latest at this fraction of the run; the earlier ones share it
  /// equally.
  double latest_last = 0.2;
  /// When pictures are asked about relabelled commands beside the demonstrated one: always | never | before_last (the
  /// authors': the last subtask is trained on what was demonstrated alone).
  std::string relabelled = "always";
  /// Module -> error (1 - accuracy, px, m) that is good enough whatever the trend.
  std::map<std::string, double> goals;

  void Visit(auto& v) {
    v("enabled", enabled, "", "false: every subtask from the start");
    v("improvement", improvement, "-",
      "a module has converged when its best error improved by less than this fraction");
    v("patience", patience, "-", "evaluations over which that is looked at");
    v("latest_last", latest_last, "-", "fraction of the run at which the last subtask starts at the latest");
    v("relabelled", relabelled, "",
      "when pictures are asked about relabelled commands, too: always | before_last (subtask) | never");
    v("goals", goals, "1, px or m", "error of a module that is good enough whatever the trend");
  }

  void Check(std::vector<std::string>& errors) const;
};

/// One subtask: the modules of one level.
struct Subtask {
  int level = 1;
  std::vector<std::string> modules;

  std::string Name() const;  ///< "EE2D+TAR2D"
};

enum class Cause { kGoal, kConverged, kBudget };
std::string_view ToString(Cause cause);  ///< goal | plateau | budget; as written in a run's files

/// One step forward, kept for the record.
struct Advance {
  int from = 0, to = 0;  ///< counts of subtasks in training, 1-based
  std::uint64_t step = 0;
  Cause cause = Cause::kConverged;
  std::string reason;  ///< for people: "EE2D 0.31 px: improved by 4 % in 2 evaluations"
};

/// Pure state machine. Invariants: stage() never falls, grows by one at a time and is in [1,
/// stages()].
class Scheduler {
 public:
  /// @param subtasks  by ascending level, at least one
  Scheduler(const CurriculumConfig& config, std::vector<Subtask> subtasks);

  /// Begins with the subtask of `level`: what is below it was learned before. @pre nothing was observed yet
  void StartAt(int level);

  int stage() const { return stage_; }  ///< subtasks 1..stage() are trained
  int stages() const { return static_cast<int>(subtasks_.size()); }
  /// Whether relabelled commands are asked while modules of `level` and below are trained.
  bool RelabelledAt(int level) const;
  /// Modules of this level and below are trained.
  int level() const { return subtasks_[static_cast<std::size_t>(stage_ - 1)].level; }
  std::string StageName() const { return subtasks_[static_cast<std::size_t>(stage_ - 1)].Name(); }
  const std::vector<Advance>& advances() const { return advances_; }

  /// A validation result. @param progress  of the run, [0, 1]   @param errors  module -> error,
  /// lower is better; modules that are missing or not finite count as not converged: they are in unmeasured() then.
  std::optional<Advance> Observe(std::uint64_t step, double progress, const std::map<std::string, double>& errors);
  /// Only looks at the budget; call as often as you like.
  std::optional<Advance> Tick(std::uint64_t step, double progress);

  /// Modules of this stage without an error at the last Observe: only the budget ends the stage while there are any.
  const std::set<std::string>& unmeasured() const { return unmeasured_; }
  /// True once for each stage that has such modules, so that it is said and not repeated.
  bool NewlyUnmeasured();
  /// Fraction of the run at which this stage ends at the latest.
  double Budget() const;

  OrderedJson Save() const;
  /// @error kCorrupt when it does not fit; the scheduler is unchanged then.
  Status Restore(const OrderedJson& state);

 private:
  Advance Go(std::uint64_t step, Cause cause, std::string reason);

  CurriculumConfig config_;
  std::vector<Subtask> subtasks_;
  int stage_ = 1;
  std::map<std::string, std::vector<double>> history_;  // errors since the stage began
  std::set<std::string> unmeasured_;
  int said_stage_ = 0;  // whose unmeasured modules were told of
  std::vector<Advance> advances_;
};

}  // namespace etude::curriculum
