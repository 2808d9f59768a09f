// SPDX-License-Identifier: Apache-2.0
// Private to worker/sim: a user's robot turned into a RobotModel.
#pragma once

#include <string>

#include "worker/sim/model.h"
#include "worker/sim/robot_file.h"
#include "worker/sim/robot_xml.h"

namespace etude::sim {

/// The robot alone, compiled, to look names and values up in.
/// @param settings  attributes of <compiler> besides
/// @param equality  its equalities; with them come its tendons
Result<ModelPtr> CompileAlone(const RobotXml& xml, const std::string& settings = {}, const std::string& equality = {});

/// @param alone  `xml` compiled
/// @param origin  who is at fault, for errors
/// @error kInvalidArgument: all that is wrong at once
Result<LoadedRobot> BuildRobot(const RobotFile& file, RobotXml& xml, const mjModel* alone, const std::string& origin);

}  // namespace etude::sim
