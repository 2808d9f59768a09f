// SPDX-License-Identifier: Apache-2.0
// Whether a task can be done in a scene at all, before anything moves: a scene in which it cannot is drawn anew.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "worker/collide/checker.h"
#include "worker/task/stage.h"

namespace etude::task {

/// Everything as it is now, except what the stages do to the target.
struct Rehearsal {
  sim::Kinematics* kinematics = nullptr;
  collide::Checker* checker = nullptr;  ///< knows all objects; left as the last stage needs it
  Eigen::VectorXd q;                    ///< arm at the start
};

/// Goes through the goals of `stages`, each computed from where the stages before would leave hand and target.
/// @returns the first goal that the arm cannot be at without a collision, and why; nothing when there is none.
std::optional<std::string> Rehearse(const std::vector<Stage>& stages, Situation now, Rehearsal rehearsal);

/// Tells `checker` what a stage may touch and what it holds. `X_EO` counts only for stages that hold.
void SetForStage(const Stage& stage, const std::string& target, const std::optional<Pose>& X_EO,
                 collide::Checker& checker);

}  // namespace etude::task
