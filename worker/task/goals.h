// SPDX-License-Identifier: Apache-2.0
// Where the hand goes in each stage, for hands that come from the side and for hands that come from above.
// Internal to worker/task.
#pragma once

#include "worker/task/stage.h"

namespace etude::task {

/// One goal for each kind of moving stage. Empty where the style has none.
struct TaskGoals {
  Goal before_grasp, at_grasp, lifted;
  Goal before_push, pushed, pushed_less;
  Goal turned, laid;       ///< the object turned over by 90 degrees; and laid on the table
  Goal carried, set_down;  ///< beside the reference: above it; and on the table
  Goal retreated;
};

/// The hand level, along +y: UR5.
TaskGoals SideGoals();
/// The hand pitched down by `pitch` (rad, above 0), see Hand(). `task` says which way "beside" is and how far a
/// turn goes.
TaskGoals AboveGoals(double pitch, const TaskName& task);

/// Lowest point of what the hand holds below E when E is oriented q_WE, m. @pre now.X_EO
double HeldBelow(const Situation& now, const Eigen::Quaterniond& q_WE);

}  // namespace etude::task
