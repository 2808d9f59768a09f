// SPDX-License-Identifier: Apache-2.0
// Whether a task can be done in a scene at all, before anything moves: a scene in which it cannot is drawn anew.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "worker/collide/checker.h"
#include "worker/task/primitives/stage.h"

namespace etude::task {

/// Everything as it is now, except what the stages do to the target.
struct FeasibilityCheck {
  sim::Kinematics* kinematics = nullptr;
  collide::Checker* checker = nullptr;  ///< knows all objects; left as the last stage needs it
  Eigen::VectorXd q;                    ///< arm at the start
  std::string near_wanted = {};         ///< body that may be near without touching: what the target goes on or into
};

/// Why a start that was drawn is not used.
struct Rejection {
  std::string reason;  ///< one of few, to be counted: "no_arm_start", "reach: out_of_reach"
  std::string detail;  ///< the same with names and numbers
};

/// Goes through the goals of `stages`, each computed from where the stages before would leave hand and target.
/// @returns the first goal that the arm cannot be at without a collision, and why; nothing when there is none. Reasons:
/// "STAGE: " and out_of_reach | too_stretched | touches | too_near | whirls.
std::optional<Rejection> CheckFeasible(const std::vector<Stage>& stages, StageContext now, FeasibilityCheck check);

/// Tells `checker` what a stage may touch and what it holds. `X_EO` counts only for stages that hold.
void SetForStage(const Stage& stage, const std::string& target, const std::optional<Pose>& X_EO,
                 collide::Checker& checker);

}  // namespace etude::task
