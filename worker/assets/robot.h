// SPDX-License-Identifier: Apache-2.0
// Robots as data: an arm with its gripper in MJCF, with everything that others need to know by
// name. How many joints an arm has is data, too.
#pragma once

#include <string>
#include <vector>

#include "worker/assets/object.h"

namespace etude::assets {

/// The tool frame E of every robot has its origin in the fingertip zone; x_E points back along the hand
/// (minus the approach direction), y_E along the opening of the fingers. A hand that points straight down
/// with fingers that close along world x has x_E = +z_W.
struct RobotModel {
  std::string name;
  std::string defaults;                    ///< MJCF <default> classes
  std::string materials;                   ///< content of <asset>
  std::string body;                        ///< MJCF <body> tree, its base where it stands in the scene
  std::string equality, tendon, actuator;  ///< content of these MJCF sections
  std::vector<AssetFile> files;

  std::vector<std::string> joints;  ///< arm joints, base to tool; each has a motor of its name
  std::vector<double> q_home;       ///< rad
  std::vector<double> joint_speed;  ///< rad/s, the published most of each arm joint
  /// rad/s, the most that motions are planned for: less than joint_speed where damping would take too much torque
  std::vector<double> planned_speed;
  std::vector<std::string> bodies;  ///< base to fingers
  /// Driven; [0] has a motor of its name.
  std::vector<std::string> gripper_joints;
  /// Joints coupled to gripper_joints[0]: q = offset + factor * q_driven.
  struct Coupled {
    std::string joint;
    double factor = 0, offset = 0;
  };
  std::vector<Coupled> coupled_joints;
  double gripper_open = 0;                   ///< driven joint when open, rad or m
  double gripper_closed = 0;                 ///< driven joint when closed on air
  double open_torque = 0, close_torque = 0;  ///< N m (or N of a slide), on the driven joint
  /// An object is grasped when every group has a body that touches it.
  std::vector<std::vector<std::string>> finger_groups;
  /// rad below the horizontal from which the hand naturally comes at an object: 0 level, pi/2 from above
  double approach_pitch = 0;
  /// rad: pitch of the hand after it has turned an object over by 90 degrees, approach_pitch +- pi/2
  double turned_pitch = 1.5707963267948966;
  std::string tool_site;
};

}  // namespace etude::assets
