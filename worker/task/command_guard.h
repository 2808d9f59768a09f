// SPDX-License-Identifier: Apache-2.0
// The last thing before a command of a rollout: no joint is driven faster than it may turn, and no two bodies of the
// arm that are apart at home into each other.
#pragma once

#include <memory>

#include "worker/collide/checker.h"
#include "worker/sim/controller.h"
#include "worker/sim/world.h"
#include "worker/task/episode_runner.h"

namespace etude::task {

/// Joint velocities (n, rad/s) that are allowed, each on its own.
struct JointBox {
  Eigen::VectorXd low, high;
};

/// Joint velocities (n, rad/s) within `box` that move the tool as `V_WE` (6, m/s and rad/s, linear first) asks, as
/// nearly as it allows: near a singularity what would turn the wrist without end is left out, the rest is slowed along
/// its direction.
/// @param J  (6, n) of the tool
/// @pre low <= high
Eigen::VectorXd JointVelocityWithin(const Eigen::MatrixXd& J, const Eigen::Matrix<double, 6, 1>& V_WE,
                                    const JointBox& box);

/// Changes a command whose spring and path would soon have a joint turn faster than its limit: a hand that lags (it
/// hung on something, what it pushed gave way), a reference that turns at a new answer, a wrist that has to turn over;
/// and one that would fold the arm into itself (self_damping.h), on a way that was demonstrated from elsewhere. What
/// the controller of a redundant arm does besides for its posture is not foreseen.
/// Besides, a target leads the hand by 15 mm and 0.15 rad at most: more would only press on what is in the way. All
/// other commands pass as they are. A hand whose joints turn too fast all the same (it slips off what it leans on) is
/// stopped. The Tracker bounds what the path asks of the joints; this, what the controller does.
class CommandGuard {
 public:
  /// @param checker  borrowed; of the same scene
  CommandGuard(std::shared_ptr<const sim::Scene> scene, collide::Checker* checker)
      : kinematics_(std::move(scene)), checker_(checker) {}

  /// @param world  in which `command` is the next
  Command Guarded(const Command& command, const sim::World& world);

 private:
  sim::Kinematics kinematics_;
  collide::Checker* checker_;
  sim::ControllerConfig config_;
};

}  // namespace etude::task
