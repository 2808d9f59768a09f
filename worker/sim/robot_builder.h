// SPDX-License-Identifier: Apache-2.0
// Private to worker/sim: a user's robot turned into a RobotModel.
#pragma once

#include <string>
#include <vector>

#include "worker/sim/model.h"
#include "worker/sim/robot_file.h"
#include "worker/sim/robot_xml.h"

namespace etude::sim {

/// The robot alone, compiled, to look names and values up in.
/// @param settings  attributes of <compiler> besides
/// @param equality  its equalities; with them come its tendons
Result<ModelPtr> CompileAlone(const RobotXml& xml, const std::string& settings = {}, const std::string& equality = {});

/// Writes the masses and inertias that its own <compiler> would have given its bodies into the document, so that it
/// has them under other settings.
Status FixMasses(RobotXml& xml);

/// Takes their mass from the visual geoms of each body that has a mass without them; before FixMasses.
/// @error kInvalidArgument: MuJoCo refuses the robot
Status LightenVisuals(RobotXml& xml);

/// What its visual geoms weigh, see WeighVisuals(yaml), by the settings of its own <compiler>; takes it before
/// FixMasses.
/// @error kInvalidArgument: MuJoCo refuses the robot
Result<std::vector<VisualMass>> WeighVisuals(RobotXml xml);

/// @param alone  `xml` compiled
/// @param origin  who is at fault, for errors
/// @error kInvalidArgument: all that is wrong at once
Result<LoadedRobot> BuildRobot(const RobotFile& file, RobotXml& xml, const mjModel* alone, const std::string& origin);

}  // namespace etude::sim
