// SPDX-License-Identifier: Apache-2.0
// A policy's outputs as others read them: robots, rollouts, people.
#pragma once

#include <vector>

#include "services/core/config.h"
#include "trainer/policy/policy.h"

namespace etude::policy {

/// What every module says of the first sample and sentence, trajectories left out:
///   {"TAR3D": {"entity": "target", "quantity": "position", "unit": "m", "value": [x, y, z]}, ...}
/// Rotations are in 6D; a class is {"value": "coke", "probability": 0.98}; modules that look at the picture add
/// "soft_argmax" (px). Which modules there are and what they mean is the policy's file's.
OrderedJson DescribeModules(const PolicyConfig& config, const Outputs& outputs);

/// (kWaypoints, kWaypointSize) of the first sample's first sentence, as WaypointsOf; undefined: no module decodes a
/// trajectory.
torch::Tensor WaypointTensor(const PolicyConfig& config, const Outputs& outputs);

/// The waypoints of the module that decodes a trajectory, kWaypoints * kWaypointSize numbers as in
/// services/episode/action.h, rotations in 6D whatever the head's form. Empty: no module decodes one.
std::vector<float> WaypointsOf(const PolicyConfig& config, const Outputs& outputs);

}  // namespace etude::policy
