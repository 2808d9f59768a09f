// SPDX-License-Identifier: Apache-2.0
// Private to worker/sim. Masses of a user's robot: written into its document, and what visual geoms weigh.
#pragma once

#include <vector>

#include "worker/sim/model.h"
#include "worker/sim/robot_file.h"
#include "worker/sim/robot_xml.h"

namespace etude::sim {

/// Writes the masses and inertias that its own <compiler> would have given its bodies into the document, so that it
/// has them under other settings.
Status FixMasses(RobotXml& xml);

/// Takes their mass from the visual geoms of each body that has a mass without them; before FixMasses.
/// @error kInvalidArgument: MuJoCo refuses the robot
Status LightenVisuals(RobotXml& xml);

/// What its visual geoms weigh, see WeighVisuals, by the settings of its own <compiler>; takes it before FixMasses.
/// @error kInvalidArgument: MuJoCo refuses the robot
Result<std::vector<VisualMass>> VisualMassesOf(RobotXml xml);

}  // namespace etude::sim
