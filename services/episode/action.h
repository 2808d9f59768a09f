// SPDX-License-Identifier: Apache-2.0
// What a policy answers: waypoints of the end-effector over the next control steps.
#pragma once

#include <array>
#include <vector>

#include "services/episode/pose.h"

namespace etude {

inline constexpr double kControlRate = 125.0;  ///< Hz; one control step is 8 ms
inline constexpr int kWaypoints = 12;          ///< control points of a trajectory
inline constexpr int kHorizonSteps = 120;      ///< control steps they span (0.96 s)
/// x, y, z (m), rotation as in Rotation6D, gripper (0 open .. 1 closed). On disk, on the wire and in a policy's head.
inline constexpr int kWaypointSize = 10;
/// How a waypoint's rotation is written, as messages and checkpoints say it.
inline constexpr const char* kRotationFormat = "6d";
/// Names of the numbers of a waypoint, as files and tables print them.
inline constexpr const char* kWaypointNames = "x y z r1x r1y r1z r2x r2y r2z gripper";

/// Target of the controller at one instant.
struct Waypoint {
  Pose X_WE;           ///< end-effector in world
  double gripper = 0;  ///< 0 open .. 1 closed; commanded closed when > 0.5
};

std::array<float, kWaypointSize> ToVector(const Waypoint& waypoint);
/// Inverse of ToVector; rotations by FromRotation6D: NaN where the numbers are no rotation.
Waypoint FromVector(const float* values);

/// Control points sit at steps k * (kHorizonSteps - 1) / (kWaypoints - 1), k = 0..11, after `now`
/// (Section "trajectory" of the design; the original evaluates the same piecewise-linear curve).
double WaypointStep(int k);

/// Piecewise-linear position, slerp orientation, nearest-past gripper.
/// @param waypoints  kWaypoints of them   @param step  in [0, kHorizonSteps - 1], clamped
Waypoint Interpolate(const std::vector<Waypoint>& waypoints, double step);

}  // namespace etude
