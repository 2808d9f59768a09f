// SPDX-License-Identifier: Apache-2.0
// Labels of one picture, computed from the tracks of its episode. Names and shapes: labels.h.
#pragma once

#include <array>

#include "services/episode/action.h"
#include "services/episode/episode.h"

namespace etude::data {

/// Position (m, world) then sine and cosine of roll, pitch, yaw ("rxyz").
inline constexpr int kPoseSize = 9;

/// Where something is at one control step.
struct PointLabel {
  std::array<float, 2> pixel{};  ///< px in the camera's picture; NaN behind the camera
  std::array<float, kPoseSize> pose{};
};

/// The waypoints to imitate from one control step on.
struct TrajectoryLabel {
  std::array<float, kWaypoints * kWaypointSize> values{};  ///< (12, 10)
  std::array<bool, kWaypoints> valid{};
};

/// @param step  control step, in [0, episode.steps())
PointLabel LabelObject(const ObjectTrack& object, int step);
PointLabel LabelHand(const Episode& episode, int step);

/// The *commanded* poses at step + WaypointStep(k): the expert's reference, which leads the
/// achieved pose by the controller's lag, so that tracking the answer reproduces the expert's
/// motion instead of a slower one. The first waypoint is the command of `step` itself; behind the
/// end the last command is held. A waypoint is valid while every step from `step` to it is
/// supervised (nothing predicts a disturbance).
TrajectoryLabel LabelTrajectory(const Episode& episode, int step);

/// False at steps where a disturbance drives the arm.
bool Supervised(const Episode& episode, int step);

}  // namespace etude::data
