// SPDX-License-Identifier: Apache-2.0
// Tells a person whether a robot can collect, and what is missing (`etude robot check`).
#pragma once

#include <string>

#include "services/core/result.h"
#include "worker/sim/renderer.h"

namespace etude {

/// Prints a line for each thing that a robot needs: it compiles, joints, masses, home, gripper, reach, a pick of the
/// cube by the expert.
/// @param robot  path of a robot file (worker/sim/robot_file.h), or the name of a known robot
/// @error kNotFound, kInvalidArgument: it cannot collect, and which lines say why
Status CheckRobot(const std::string& robot, const sim::RendererConfig& renderer);

}  // namespace etude
