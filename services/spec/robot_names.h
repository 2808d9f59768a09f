// SPDX-License-Identifier: Apache-2.0
// The robots that a campaign may name: those that come with the programs, and files of one's own.
#pragma once

#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude {

/// Those that come along: deploy/robots/NAME.yaml of each, sorted; empty when the folder is not found.
std::vector<std::string> KnownRobots();
/// The YAML of a robot: `robot` itself when it ends in .yaml, else that of the known robot of this name.
/// @error kInvalidArgument: unknown name, the message has the nearest known one; kNotFound: no folder of robots
Result<Path> FindRobot(const std::string& robot);

}  // namespace etude
