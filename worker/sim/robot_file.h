// SPDX-License-Identifier: Apache-2.0
// Robots: any MJCF arm, with a small YAML that names its joints, gripper, tool and home. Those that come along are such
// files, too.
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "worker/assets/robot.h"
#include "worker/sim/scene.h"

namespace etude::sim {

/// Value of `masses`: visual geoms weigh nothing where others give their body a mass.
inline constexpr const char* kMassesOfCollision = "collision";

/// The YAML, key by key. Directions and positions of `tool` are in the site's (or body's) frame.
struct RobotFile {
  std::string name;
  std::string mjcf;                            ///< path, relative to the YAML
  std::vector<std::string> joints;             ///< arm joints, base to tool
  std::vector<double> home;                    ///< rad
  std::vector<double> torque;                  ///< N m; empty: the limits of the MJCF's actuators
  std::vector<double> armature;                ///< kg m^2, rotors seen through their gears; empty: the MJCF's
  std::vector<double> damping;                 ///< N m s/rad; empty: the MJCF's
  std::vector<double> speed;                   ///< rad/s, the most of each joint; empty: 2 each
  double approach_pitch = 1.5707963267948966;  ///< rad below the horizontal: 0 level, pi/2 from above
  /// rad, added to approach_pitch to turn an object over: pi/2 or -pi/2 (not of a level hand, which turns down); 0:
  /// towards level, or down from it
  double turn = 0;
  /// check: implausible ones are an error; trust: a warning; kMassesOfCollision: as check, visual geoms weigh nothing
  std::string masses = "check";

  struct Base {
    std::vector<double> position{0, -0.3, 0};  ///< m, of the robot's root body
    double yaw = 0;                            ///< rad
    void Visit(auto& v) {
      v("position", position, "m", "of the robot's root body, world");
      v("yaw", yaw, "rad",
        "of the robot's root body, besides the turn that it has in its file where it is not upright");
    }
  } base;

  struct Tool {
    std::string site, body;                 ///< one of the two
    std::vector<double> position{0, 0, 0};  ///< m
    std::vector<double> approach{0, 0, 1};  ///< where the hand points
    std::vector<double> opening{1, 0, 0};   ///< along which the fingers open, either sign
    void Visit(auto& v) {
      v("site", site, "", "site between the fingertips, or give body");
      v("body", body, "", "body that the tool is fixed to, or give site");
      v("position", position, "m", "of the tool in the site or body");
      v("approach", approach, "-", "direction in which the hand points, there");
      v("opening", opening, "-", "direction along which the fingers open, there; either sign");
    }
  } tool;

  struct Gripper {
    std::string mjcf;                       ///< of a gripper in a file of its own, relative to the YAML
    std::string attach;                     ///< body or site of the arm that it is mounted on
    std::vector<double> position{0, 0, 0};  ///< m, of the gripper file's world there: its root keeps its own pose in it
    std::vector<double> euler{0, 0, 0};     ///< rad, alike: roll, pitch, yaw
    std::string joint;                      ///< driven
    std::map<std::string, double> coupled;  ///< joints that follow it, each from its `ref`, times this factor
    double open = 0, closed = 0;            ///< of the driven joint, rad or m
    double force = 0;                       ///< N m or N on the driven joint, > 0
    std::vector<std::vector<std::string>> fingers;  ///< groups of bodies
    void Visit(auto& v) {
      v("mjcf", mjcf, "", "of a gripper in a file of its own, relative to this file");
      v("attach", attach, "", "body or site of the arm on which that one is mounted");
      v("position", position, "m", "of that gripper file's world there, in which its root keeps its own pose");
      v("euler", euler, "rad", "of that gripper file's world there: roll, pitch, yaw");
      v("joint", joint, "", "joint that is driven");
      v("coupled", coupled, "-", "joints that follow it, each by its factor (what both are away from their `ref`)");
      v("open", open, "rad or m", "of the driven joint");
      v("closed", closed, "rad or m", "of the driven joint");
      v("force", force, "N m or N", "on the driven joint, > 0");
      v("fingers", fingers, "", "groups of bodies, a group a finger");
    }
  } gripper;

  void Visit(auto& v) {
    v("name", name, "", "plain name of the robot");
    v("mjcf", mjcf, "", "the arm's MJCF, relative to this file");
    v("joints", joints, "", "arm joints, base to tool");
    v("home", home, "rad", "angles in which an episode starts");
    v("torque", torque, "N m", "limit of each joint; none: those of the MJCF's actuators");
    v("speed", speed, "rad/s", "limit of each joint; none: 2 each");
    v("armature", armature, "kg m^2", "rotors seen through their gears; none: the MJCF's");
    v("damping", damping, "N m s/rad", "of each joint; none: the MJCF's");
    v("approach_pitch", approach_pitch, "rad",
      "how far below the horizontal the hand points at an object: 0 level, pi/2 from above");
    v("turn", turn, "rad", "added to approach_pitch to turn an object over; 0: towards level, or down from it");
    v("masses", masses, "",
      "check: implausible ones are an error | trust: a warning | collision: as check, and visual geoms weigh nothing "
      "where others do");
    v("base", base, "", "where the arm stands");
    v("tool", tool, "", "the frame that goes where it is told");
    v("gripper", gripper, "", "its fingers, and how they close");
  }
};

struct LoadedRobot {
  assets::RobotModel model;
  bool trust_masses = false;
  std::vector<std::string> notes;  ///< what was left out or assumed, a line each
  std::vector<Path> sources;       ///< every file that it was read from
  std::set<std::string> names;     ///< of its bodies, joints, geoms and sites as the files have them
};

/// True when a spec's robot is a file of the user's own, and not one that comes along.
bool IsRobotFile(const std::string& robot);

/// Reads the MJCF where it stands (includes, meshes, default classes), takes its robot out of it with motors in
/// place of its actuators, and makes a RobotModel of that. Lights, cameras, sensors, and what else stands in its
/// world stay behind. Files that did not change since are not read again.
/// @param taken  names that bodies, joints, geoms and sites must not have; those that do get another
/// @error kNotFound: a file; kInvalidArgument: all that is wrong with YAML or MJCF, MuJoCo's message
/// Thread-safe.
Result<LoadedRobot> LoadRobot(const Path& yaml, const std::set<std::string>& taken = {});

struct MassReport {
  double total = 0;                      ///< kg, of what moves
  std::vector<std::string> implausible;  ///< a line for each body whose mass or inertia no such thing has
};
MassReport WeighRobot(const Scene& scene);

/// Mass of a body's visual geoms: those that collide with nothing.
struct VisualMass {
  std::string body;  ///< as the file has it
  double mass = 0;   ///< kg
};

/// Those bodies, heaviest first, in which visual geoms weigh something beside those that collide. Where both show the
/// same link it weighs twice; many published robots leave their visual meshes the default density. The base, which
/// stands still, is left out. Reads and compiles the files anew.
/// @error as LoadRobot
Result<std::vector<VisualMass>> WeighVisuals(const Path& yaml);

}  // namespace etude::sim
