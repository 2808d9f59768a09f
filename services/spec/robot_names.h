// SPDX-License-Identifier: Apache-2.0
// The robots that a campaign may name: those that come with the programs, and files of one's own.
#pragma once

#include <string>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude {

/// The YAML of a robot: `robot` itself when it ends in .yaml, else deploy/robots/NAME.yaml of those that come along.
/// @error kInvalidArgument: unknown name, the message has the nearest known one; kNotFound: no folder of robots
Result<Path> FindRobot(const std::string& robot);

}  // namespace etude
