// SPDX-License-Identifier: Apache-2.0
// Robots of the user's own: any MJCF arm, with a small YAML that names its joints, gripper, tool and home.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "worker/assets/robot.h"
#include "worker/sim/scene.h"

namespace etude::sim {

/// The YAML, key by key. Directions and positions of `tool` are in the site's (or body's) frame.
struct RobotFile {
  std::string name;
  std::string mjcf;                            ///< path, relative to the YAML
  std::vector<std::string> joints;             ///< arm joints, base to tool
  std::vector<double> home;                    ///< rad
  std::vector<double> torque;                  ///< N m; empty: the limits of the MJCF's actuators
  std::vector<double> speed;                   ///< rad/s, the most of each joint; empty: 2 each
  double approach_pitch = 1.5707963267948966;  ///< rad below the horizontal: 0 level, pi/2 from above
  /// rad, added to approach_pitch to turn an object over: pi/2 or -pi/2; 0: towards level, or down from it
  double turn = 0;

  struct Base {
    std::vector<double> position{0, -0.3, 0};  ///< m, of the robot's root body
    double yaw = 0;                            ///< rad
    template <class V>
    void Visit(V& v) {
      v("position", position);
      v("yaw", yaw);
    }
  } base;

  struct Tool {
    std::string site, body;                 ///< one of the two
    std::vector<double> position{0, 0, 0};  ///< m
    std::vector<double> approach{0, 0, 1};  ///< where the hand points
    std::vector<double> opening{1, 0, 0};   ///< along which the fingers open, either sign
    template <class V>
    void Visit(V& v) {
      v("site", site);
      v("body", body);
      v("position", position);
      v("approach", approach);
      v("opening", opening);
    }
  } tool;

  struct Gripper {
    std::string joint;                              ///< driven
    std::map<std::string, double> coupled;          ///< joints that follow it, times this factor
    double open = 0, closed = 0;                    ///< of the driven joint, rad or m
    double force = 0;                               ///< N m or N on the driven joint, > 0
    std::vector<std::vector<std::string>> fingers;  ///< groups of bodies
    template <class V>
    void Visit(V& v) {
      v("joint", joint);
      v("coupled", coupled);
      v("open", open);
      v("closed", closed);
      v("force", force);
      v("fingers", fingers);
    }
  } gripper;

  template <class V>
  void Visit(V& v) {
    v("name", name);
    v("mjcf", mjcf);
    v("joints", joints);
    v("home", home);
    v("torque", torque);
    v("speed", speed);
    v("approach_pitch", approach_pitch);
    v("turn", turn);
    v("base", base);
    v("tool", tool);
    v("gripper", gripper);
  }
};

struct LoadedRobot {
  assets::RobotModel model;
  std::vector<std::string> notes;  ///< what was left out or assumed, a line each
};

/// True when a spec's robot is such a file.
bool IsRobotFile(const std::string& robot);

/// Compiles the MJCF where it stands (includes, meshes, default classes), takes its robot out of it with motors in
/// place of its actuators, and makes a RobotModel of that. Lights, cameras, sensors, and what else stands in its
/// world stay behind.
/// @error kNotFound: a file; kInvalidArgument: all that is wrong with YAML or MJCF, MuJoCo's message
/// Thread-safe.
Result<LoadedRobot> LoadRobot(const Path& yaml);

struct MassReport {
  double total = 0;                      ///< kg, of what moves
  std::vector<std::string> implausible;  ///< a line for each body whose mass or inertia no such thing has
};
MassReport WeighRobot(const Scene& scene);

}  // namespace etude::sim
