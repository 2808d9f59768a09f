// SPDX-License-Identifier: Apache-2.0
// Time along a joint curve: as fast as the limits of joints and tool allow, to rest at the end.
#pragma once

#include <optional>

#include "worker/plan/joint_curve.h"
#include "worker/plan/planner.h"

namespace etude::plan::internal {

/// Speeds by a forward and a backward pass over the squared rate of the curve's parameter, as in
/// Bobrow, Dubowsky & Gibson 1985, with velocity limits and with half of each acceleration limit
/// left to curvature. The poses are moved by what the curve's end misses of `X_WE_goal`.
/// @returns nothing when it would take more than a minute.
std::optional<Motion> Retime(const JointCurve& curve, sim::Kinematics& kinematics, const Limits& limits,
                             double start_speed, const Pose& X_WE_goal);

}  // namespace etude::plan::internal
