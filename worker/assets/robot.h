// SPDX-License-Identifier: Apache-2.0
// Robots as data: an arm with its gripper in MJCF, with everything that others need to know by
// name.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "worker/assets/object.h"

namespace etude::assets {

struct RobotModel {
  std::string name;
  std::string materials;           ///< MJCF <material> elements
  std::string body;                ///< MJCF <body> tree, its base where it stands in the scene
  std::string equality, actuator;  ///< content of these MJCF sections
  std::vector<AssetFile> files;

  std::vector<std::string> joints;          ///< arm joints, base to tool
  std::vector<double> q_home;               ///< rad
  std::vector<std::string> bodies;          ///< base to fingers
  std::vector<std::string> gripper_joints;  ///< driven
  /// Joints coupled to gripper_joints[0]: q = factor * q_driven.
  struct Coupled {
    std::string joint;
    double factor;
  };
  std::vector<Coupled> coupled_joints;
  double gripper_closed = 0;                 ///< driven joint when closed on air
  double open_torque = 0, close_torque = 0;  ///< N m, on the driven joint
  std::vector<std::string> finger_bodies;    ///< that close on an object
  std::string tool_site;
};

const std::vector<std::string>& KnownRobots();
/// @error kInvalidArgument: unknown name
Result<RobotModel> MakeRobot(const std::string& name);

}  // namespace etude::assets
