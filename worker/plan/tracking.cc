// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/tracking.h"

#include "services/core/check.h"
#include "worker/sim/controller.h"

namespace etude::plan {

std::vector<Eigen::VectorXd> TrackedVelocities(sim::Kinematics& kinematics, const sim::ArmInfo& arm,
                                               const Motion& motion, const Eigen::VectorXd& q_start) {
  ETUDE_CHECK(arm.is_redundant(), "n={}", q_start.size());
  constexpr double kStep = 1 / kControlRate;
  constexpr double kDamping = 5e-3;  // m (and rad)
  sim::ControllerConfig config;
  config.share_damping = kDamping;  // what the force does near a singularity is asked of the joints here
  Eigen::VectorXd q = q_start;
  sim::ControlState state;
  state.speed = arm.planned_speed;
  std::vector<Eigen::VectorXd> velocities;
  velocities.reserve(motion.X_WE.size());
  for (int k = 0; k < motion.steps(); ++k) {
    state.X_WE = kinematics.X_WE(q);
    state.J = kinematics.Jacobian(q);
    if (k == 0) state.v = sim::JointMotion(state.J, motion.V_WE[0], config.share_damping);
    state.posture = arm.q_home - q;
    const auto acceleration = sim::ToolAcceleration(state, motion.X_WE[k], motion.V_WE[k], config);
    state.v += kStep * sim::RedundantAcceleration(state, acceleration, config);
    q += kStep * state.v;
    velocities.push_back(state.v);
  }
  return velocities;
}

}  // namespace etude::plan
