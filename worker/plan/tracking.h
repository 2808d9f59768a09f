// SPDX-License-Identifier: Apache-2.0
// How the joints of a redundant arm move while its controller follows a motion of the tool.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "worker/plan/line_motion.h"
#include "worker/sim/scene.h"

namespace etude::plan {

/// Joint velocities (nv, rad/s) at each control step of `motion`, the arm starting at `q_start` with the motion's first
/// velocity. Inverse kinematics tells where a redundant arm's joints would come to rest at each pose of the tool; the
/// controller needs a while to slide there, and until then the same way of the tool asks other speeds of the joints:
/// near a singularity far higher ones. Integrates what the controller asks for, without the arm's dynamics.
/// @param kinematics  of the same scene as `arm`, which has more joints than a pose has freedoms
std::vector<Eigen::VectorXd> TrackedVelocities(sim::Kinematics& kinematics, const sim::ArmInfo& arm,
                                               const Motion& motion, const Eigen::VectorXd& q_start);

}  // namespace etude::plan
