// SPDX-License-Identifier: Apache-2.0
// Private to worker/sim: joints of a gripper that follow the driven one because a closed chain of bodies makes them,
// and the bodies that it moves.
#pragma once

#include <string>
#include <vector>

#include "worker/assets/robot.h"
#include "worker/sim/model.h"

namespace etude::sim {

/// A joint that goes with the driven one: q = offset + factor * q_driven, rad or m.
struct Follower {
  std::string joint;
  double offset = 0, factor = 0;
  double deviation = 0;  ///< from that line half way, rad or m: linkages are not quite straight
};

/// Drives the gripper of a robot that stands alone, without gravity and contacts, from open to closed and looks where
/// the joints go that `robot` does not name. Those that stay are not listed.
/// @param whole  the robot with its equalities and tendons; other options after the call
std::vector<Follower> MeasureFollowers(mjModel& whole, const assets::RobotModel& robot);

/// By how much closing the gripper moves each body, the arm at home: m or rad, whichever is more. In the order of
/// `alone`'s bodies; but for rounding 0 of what does not hang on the gripper.
/// @param alone  the robot that stands alone, with all joints that `robot` names
std::vector<double> StrokeOfBodies(const mjModel& alone, const assets::RobotModel& robot);

}  // namespace etude::sim
