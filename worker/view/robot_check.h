// SPDX-License-Identifier: Apache-2.0
// Tells a person whether a robot can collect, and what is missing (`etude robot check`).
#pragma once

#include <string>

#include "services/core/result.h"
#include "worker/sim/renderer.h"

namespace etude {

struct RobotCheckOptions {
  bool as_json = false;
};

/// Prints a line for each thing that a robot needs: it compiles, joints, masses, home, tool, gripper, control, reach,
/// and five demonstrations with the cube of each task that it has the joints for; then what these cost it: joints that
/// were asked for more torque than they have and for what share of the steps, and unwanted contacts by their pair.
/// Notes say what it was taken for and what is odd and yet works, such as visual geoms that weigh beside the others.
/// With `as_json` one object instead, at the end: {robot, can_collect, missing, checks: [{what, ok, text}], notes};
/// nothing of a file that cannot be read.
/// @param robot  path of a robot file (worker/sim/robot_file.h), or the name of a known robot
/// @error kNotFound, kInvalidArgument: it cannot collect, and which lines say why
Status CheckRobot(const std::string& robot, const sim::RendererConfig& renderer, const RobotCheckOptions& options = {});

}  // namespace etude
