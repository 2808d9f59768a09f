// SPDX-License-Identifier: Apache-2.0
// The report of an evaluation: success per task with Wilson intervals, and how far the modules' outputs
// were from the truth while the policy drove.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/episode/campaign_spec.h"
#include "services/episode/episode.h"

namespace etude::campaign {

/// Modules whose error is reported, in cm.
inline const std::vector<std::string> kReportedModules{"TAR3D", "EE3D", "DISP"};

/// One rollout, as eval.json lists it.
struct RolloutRow {
  std::uint64_t index = 0;
  std::uint64_t seed = 0;
  std::string task, target, instruction;
  bool success = false;
  std::string outcome;
  int steps = 0;
  int decisions = 0;
  std::uint64_t checkpoint_step = 0;  ///< of the last decision
  /// Module -> mean error over the rollout's decisions, cm; a module without a number is absent (a rollout
  /// that never had to decide, or a policy without that module).
  std::map<std::string, double> error_cm;
  std::map<std::string, double> error_before_contact_cm;  ///< of the decisions before the arm touched the target
};

/// Reads what the worker recorded in episode.details: "decisions" is a list with one map a decision:
/// {"step": n, "checkpoint_step": n, "touched": bool, "TAR3D": m, "EE3D": m, "DISP": m}. What is missing or not
/// finite is left out.
RolloutRow RowOf(const Episode& rollout);

/// {"per_task": [...], "overall": {...}, "per_episode": [...]}: n, successes, success (fraction), Wilson's
/// low and high, error_cm and error_before_contact_cm per module (mean over rollouts of their means).
OrderedJson EvalReport(const CampaignSpec& spec, const std::map<std::uint64_t, RolloutRow>& rows);

/// The report as a table for a terminal.
std::string EvalTable(const OrderedJson& report);

}  // namespace etude::campaign
