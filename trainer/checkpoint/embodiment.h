// SPDX-License-Identifier: Apache-2.0
// What a policy was trained for, and cannot be used without.
#pragma once

#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/episode/episode.h"

namespace etude::checkpoint {

/// A member at its default is not known (files of schema 1 do not say it) and is not compared.
struct Embodiment {
  std::string robot;
  int joints = 0;                   ///< numbers of an observation's joints: arm, then gripper
  int width = 0, height = 0;        ///< px, of the camera's picture
  double fovy = 0;                  ///< rad, vertical; 0: not known, or it varies
  std::vector<double> camera_pose;  ///< X_WC: x, y, z (m), quaternion w, x, y, z; empty: not known, or it moves
  std::string rotation;             ///< format of rotations in labels and on the wire
  double control_rate = 0;          ///< Hz
  int waypoints = 0;                ///< of an answer
  int horizon = 0;                  ///< control steps that they span

  void Visit(auto& v) {
    v("robot", robot, "", "name of the robot");
    v("joints", joints, "-", "numbers of an observation's joints");
    v("width", width, "px", "width of the camera's picture");
    v("height", height, "px", "height of the camera's picture");
    v("fovy", fovy, "rad", "vertical field of view; 0 when it varies");
    v("camera_pose", camera_pose, "m", "camera in world: x, y, z, quaternion w, x, y, z; empty when it moves");
    v("rotation", rotation, "", "format of rotations");
    v("control_rate", control_rate, "Hz", "control steps a second");
    v("waypoints", waypoints, "-", "waypoints of an answer");
    v("horizon", horizon, "steps", "control steps that the waypoints span");
  }
};

/// What this program does alike for every robot: rotation format, control rate, waypoints and horizon.
Embodiment OwnFormats();

/// Of what `episode` shows through its first camera, with the formats of this program.
Embodiment EmbodimentOf(const Episode& episode);

/// What is known on both sides and differs, each by name with both values: "robot: ur5 here, panda there".
/// Numbers are equal within a thousandth of a radian or a millimetre.
std::vector<std::string> Differences(const Embodiment& here, const Embodiment& there);

}  // namespace etude::checkpoint
