// SPDX-License-Identifier: Apache-2.0
// The trajectory to imitate from one picture on, computed from the commands of its episode.
#pragma once

#include <array>

#include "services/episode/action.h"
#include "services/episode/episode.h"

namespace etude {

/// The waypoints to imitate from one control step on.
struct TrajectoryLabel {
  std::array<float, kWaypoints * kWaypointSize> values{};  ///< (12, 10)
  std::array<bool, kWaypoints> valid{};
};

/// The *commanded* poses at step + WaypointStep(k): the expert's reference, which leads the
/// achieved pose by the controller's lag, so that tracking the answer reproduces the expert's
/// motion instead of a slower one. The first waypoint is the command of `step` itself; behind the
/// end the last command is held. A waypoint is valid while every step from `step` to it is
/// supervised (nothing predicts a disturbance).
/// @param step  control step, in [0, episode.steps()) @pre actions_abs has rows
TrajectoryLabel LabelTrajectory(const Episode& episode, int step);

/// False at steps where a disturbance drives the arm.
bool Supervised(const Episode& episode, int step);

}  // namespace etude
