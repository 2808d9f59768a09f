// SPDX-License-Identifier: Apache-2.0
// UR5 with a parallel two-finger gripper.
//
// Sources of the numbers:
//   kinematics, masses, centres of mass: Universal Robots, "Parameters for calculations of
//   kinematics
//     and dynamics" (support article), UR5: standard Denavit-Hartenberg table
//   joint limits, torques, speeds: UR5 user manual (+-360 deg; 150, 150, 150, 28, 28, 28 N m; 180 deg/s)
//   gripper: Robotiq 2F-85 instruction manual: 85 mm stroke, fingertips 22 x 37.5 mm, 163 mm long
//   closed;
//     the finger mechanism is a plain parallelogram of the published knuckle length
// Shapes and inertias are our own: housings are cylinders about the joint axes, tubes between them.
#include <fmt/format.h>

#include <array>
#include <cmath>

#include "worker/assets/geom_writer.h"
#include "worker/assets/robot_parts.h"

namespace etude::assets {
namespace {

using Eigen::Vector3d;

// Denavit-Hartenberg parameters, m; body i turns about z of frame i - 1
constexpr double kD1 = 0.089159, kA2 = -0.425, kA3 = -0.39225, kD4 = 0.10915, kD5 = 0.09465, kD6 = 0.0823;
constexpr std::array<double, 6> kMass{3.7, 8.393, 2.275, 1.219, 1.219, 0.1879};
constexpr std::array<double, 6> kTorque{150, 150, 150, 28, 28, 28};
// rotor inertia seen through the gears; gives the light wrist the sluggishness that a geared joint
// has
constexpr std::array<double, 6> kArmature{0.10, 0.10, 0.10, 0.03, 0.03, 0.03};

// Gripper, m. x: opening direction, z: forward, from the flange.
constexpr double kPivotX = 0.0154, kPivotZ = 0.067;       ///< knuckle hinge
constexpr double kKnuckleX = 0.0376, kKnuckleZ = 0.0430;  ///< hinge to fingertip hinge when open
constexpr double kPadFace = 0.0105;                       ///< fingertip hinge to the pad's face
constexpr double kPadThick = 0.0064, kPadHalfWidth = 0.011, kPadHalfLength = 0.01875, kPadZ = 0.036;
constexpr double kToolZ = 0.177;  ///< frame E ahead of the flange
constexpr double kClosed = 0.8;   ///< rad

std::string Name(int i) {
  static constexpr std::array kNames{"shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"};
  return fmt::format("{}_joint", kNames[i]);
}

std::string Joint(int i) { return Hinge(Name(i), kZ, -2 * kPi, 2 * kPi, kArmature[i]); }

constexpr const char *kGrey = "ur_grey", *kBlue = "ur_blue";  ///< housings and their caps

/// Base, shoulder, upper arm and forearm: opens four bodies.
std::string Proximal(Links& links) {
  const Vector3d up = 0.136 * kZ;     // the upper arm runs beside the shoulder
  const Vector3d side = 0.0165 * kZ;  // and the forearm nearly in line with it
  std::string text = Open("base", {{0, -0.3, 0}, Eigen::Quaterniond::Identity()});
  text += CylinderInertial(4.0, 0.075, 0.04, 0.02 * kZ, kZ);  // stands still: only its pose matters
  text += links.Housing(0.075, 0.0 * kZ, 0.022 * kZ, "ur_dark");
  text += links.Housing(0.060, 0.022 * kZ, 0.040 * kZ, kGrey);

  text += Open("shoulder", {}) + Joint(0);
  text += CylinderInertial(kMass[0], 0.06, 0.15, {0, -0.00193, kD1 - 0.02561}, kZ);
  text += links.Housing(0.060, 0.040 * kZ, 0.148 * kZ, kGrey);
  text += links.Look(0.056, 0.148 * kZ, 0.156 * kZ, kBlue);
  text += links.Housing(0.060, kD1 * kZ, kD1 * kZ - 0.072 * kY, kGrey);

  text += Open("upper_arm", {{0, 0, kD1}, Turn(kX, 90)}) + Joint(1);
  text += CylinderInertial(kMass[1], 0.054, 0.425, {kA2 + 0.2125, 0, 0.11336}, kX);
  text += links.Housing(0.060, 0.074 * kZ, 0.193 * kZ, kGrey);
  text += links.Look(0.056, 0.193 * kZ, 0.201 * kZ, kBlue);
  text += links.Tube(0.047, up, up + kA2 * kX, kGrey);
  text += links.Housing(0.053, kA2 * kX + 0.082 * kZ, kA2 * kX + 0.184 * kZ, kGrey);
  text += links.Look(0.049, kA2 * kX + 0.184 * kZ, kA2 * kX + 0.192 * kZ, kBlue);

  text += Open("forearm", {{kA2, 0, 0}, Eigen::Quaterniond::Identity()}) + Joint(2);
  text += CylinderInertial(kMass[2], 0.045, 0.392, {kA3 + 0.15, 0, 0.0265}, kX);
  text += links.Housing(0.050, -0.038 * kZ, 0.080 * kZ, kGrey);
  text += links.Look(0.046, -0.046 * kZ, -0.038 * kZ, kBlue);
  text += links.Tube(0.038, side, side + kA3 * kX, kGrey);
  text += links.Housing(0.040, kA3 * kX - 0.030 * kZ, kA3 * kX + 0.063 * kZ, kGrey);
  text += links.Look(0.037, kA3 * kX - 0.037 * kZ, kA3 * kX - 0.030 * kZ, kBlue);
  return text;
}

/// The three wrists: opens three bodies.
std::string Distal(Links& links) {
  std::string text = Open("wrist_1", {{kA3, 0, 0}, Eigen::Quaterniond::Identity()}) + Joint(3);
  text += CylinderInertial(kMass[3], 0.04, 0.09, {0, -0.01634, kD4 - 0.0018}, kY);
  text += links.Housing(0.040, 0.065 * kZ, 0.149 * kZ, kGrey);
  text += links.Look(0.037, 0.149 * kZ, 0.156 * kZ, kBlue);
  text += links.Housing(0.040, kD4 * kZ, kD4 * kZ - 0.046 * kY, kGrey);

  text += Open("wrist_2", {{0, 0, kD4}, Turn(kX, 90)}) + Joint(4);
  text += CylinderInertial(kMass[4], 0.04, 0.08, {0, 0.01634, kD5 - 0.0018}, kY);
  text += links.Housing(0.040, 0.048 * kZ, 0.124 * kZ, kGrey);
  text += links.Look(0.037, 0.124 * kZ, 0.130 * kZ, kBlue);
  text += links.Housing(0.040, kD5 * kZ, kD5 * kZ + 0.044 * kY, kGrey);

  text += Open("wrist_3", {{0, 0, kD5}, Turn(kX, -90)}) + Joint(5);
  text += CylinderInertial(kMass[5], 0.0375, 0.04, {0, 0, kD6 - 0.001159}, kZ);
  text += links.Housing(0.0375, 0.046 * kZ, kD6 * kZ, kGrey);
  return text;
}

/// Base to wrist 3; `hand` goes on the flange.
std::string Arm(Links& links, const std::string& hand) {
  std::string text = Proximal(links) + Distal(links) + hand;
  for (int i = 0; i < 7; ++i) text += "</body>\n";
  return text;
}

/// `s` is +1 for the finger at +x of the gripper, -1 for the other.
std::string Finger(const std::string& prefix, const std::string& driver_joint, double s) {
  const Vector3d tip_hinge(s * kKnuckleX, 0, kKnuckleZ);
  std::string text = Open(prefix + "_knuckle", {{s * kPivotX, 0, kPivotZ}, Eigen::Quaterniond::Identity()});
  text += fmt::format(
      "<joint name=\"{}\" axis=\"0 {} 0\" range=\"0 {}\" damping=\"0.25\" armature=\"0.002\" "
      "solreflimit=\"0.004 1\" solimplimit=\"0.99 0.999 0.001\"/>\n",
      driver_joint, -s, kClosed);
  text += CylinderInertial(0.03, 0.008, tip_hinge.norm(), tip_hinge / 2, tip_hinge);
  const Vector3d inner(-s * 0.011, 0, 0.004), y = 0.0055 * kY;  // the parallelogram's bars
  for (const Vector3d& bar : {Vector3d(y), Vector3d(-y), inner})
    text += GeomBetween("visual", "capsule", 0.0042, bar, tip_hinge * 0.97 + bar, "material=\"steel\"");
  text += GeomBetween("robot", "capsule", 0.0065, {0, 0, 0}, tip_hinge);
  text += Open(prefix + "_finger", {tip_hinge, Eigen::Quaterniond::Identity()});
  text += fmt::format(
      "<joint name=\"{}_tip_joint\" axis=\"0 {} 0\" range=\"-1 1\" damping=\"0.02\" "
      "armature=\"0.001\"/>\n",
      prefix, -s);
  const Vector3d half(0.0043, kPadHalfWidth, 0.0304), centre(s * 0.0002, 0, 0.0244);
  text += BoxInertial(0.05, half, centre);
  const Pose shell{centre, Eigen::Quaterniond::Identity()};
  const std::vector<double> size{half.x(), half.y(), half.z()};
  text += Geom("visual", "box", size, shell, "material=\"gripper_black\"") + Geom("robot", "box", size, shell);
  const double pad_x = -s * (kPadFace - kPadThick / 2);
  text += Geom("visual", "box", {kPadThick / 2, kPadHalfWidth, kPadHalfLength},
               {{pad_x, 0, kPadZ}, Eigen::Quaterniond::Identity()}, "material=\"pad\"");
  // two halves, so that an upright cylinder is touched at two heights and cannot pivot
  for (const double y : {-kPadHalfWidth / 2, kPadHalfWidth / 2})
    text += Geom("pad", "box", {kPadThick / 2, kPadHalfWidth / 2, kPadHalfLength},
                 {{pad_x, y, kPadZ}, Eigen::Quaterniond::Identity()});
  return text + "</body>\n</body>\n";
}

std::string Gripper(Links& links) {
  std::string text = Open("gripper", {{0, 0, kD6}, Eigen::Quaterniond::Identity()});
  text += BoxInertial(0.76, {0.034, 0.030, 0.035}, {0, 0, 0.035});
  text += links.Housing(0.0375, 0.0 * kZ, 0.014 * kZ, "steel");
  text += links.Look(0.031, 0.014 * kZ, 0.052 * kZ, "gripper_black");
  const Pose body{{0, 0, 0.047}, Eigen::Quaterniond::Identity()};
  text += Geom("visual", "box", {0.026, 0.022, 0.025}, body, "material=\"gripper_black\"");
  for (const double side : {-1.0, 1.0})  // rounded flanks about the knuckles
    text += links.Look(0.015, {side * 0.020, -0.024, 0.058}, {side * 0.020, 0.024, 0.058}, "gripper_black");
  const Pose hull{{0, 0, 0.043}, Eigen::Quaterniond::Identity()};
  text += Geom("robot", "box", {0.034, 0.030, 0.029}, hull);
  text += Finger("left", "finger_joint", +1) + Finger("right", "right_driver_joint", -1);
  // E: x back along the hand, y along the opening; level and ahead it has euler (pi, 0, pi / 2)
  Eigen::Matrix3d R;
  R << 0, 1, 0, 0, 0, -1, -1, 0, 0;
  return text + ToolSite({{0, 0, kToolZ}, Eigen::Quaterniond(R)}) + "</body>\n";
}

}  // namespace

RobotModel MakeUr5() {
  RobotModel robot;
  robot.name = "ur5";
  robot.materials =
      "<material name=\"ur_grey\" rgba=\"0.74 0.76 0.78 1\" specular=\"0.4\" shininess=\"0.4\"/>\n"
      "<material name=\"ur_blue\" rgba=\"0.33 0.62 0.84 1\" specular=\"0.3\" shininess=\"0.3\"/>\n"
      "<material name=\"ur_dark\" rgba=\"0.30 0.31 0.33 1\" specular=\"0.3\" shininess=\"0.3\"/>\n"
      "<material name=\"steel\" rgba=\"0.56 0.57 0.60 1\" specular=\"0.7\" shininess=\"0.6\"/>\n"
      "<material name=\"gripper_black\" rgba=\"0.13 0.13 0.14 1\" specular=\"0.3\" "
      "shininess=\"0.4\"/>\n"
      "<material name=\"pad\" rgba=\"0.30 0.30 0.31 1\" specular=\"0.1\" shininess=\"0.1\"/>\n";
  Links links;
  const std::string hand = Gripper(links);
  robot.body = Arm(links, hand);
  robot.files = links.TakeFiles();
  for (int i = 0; i < 6; ++i) {
    robot.joints.push_back(Name(i));
    robot.actuator += Motor(Name(i), kTorque[i]);
  }
  // E at (-0.10915, 0.133, 0.074), hand level along +y, elbow up: closed form of the planar arm
  robot.q_home = {-kPi / 2, -1.5998122986083503, 2.676480771543574, -1.0766684729352238, kPi / 2, 0};
  robot.bodies = {"base",    "shoulder", "upper_arm",    "forearm",     "wrist_1",       "wrist_2",
                  "wrist_3", "gripper",  "left_knuckle", "left_finger", "right_knuckle", "right_finger"};
  robot.gripper_joints = {"finger_joint"};
  robot.coupled_joints = {{"right_driver_joint", 1}, {"left_tip_joint", -1}, {"right_tip_joint", -1}};
  for (const auto& coupled : robot.coupled_joints) robot.equality += Couple(coupled, "finger_joint");
  robot.actuator += Motor("finger_joint", 3);
  robot.joint_speed.assign(6, kPi);
  robot.gripper_closed = kClosed;
  robot.open_torque = -1.6;
  robot.close_torque = 1.6;  // about 15 N a finger
  robot.finger_groups = {{"left_finger"}, {"right_finger"}};
  robot.approach_pitch = 0;
  robot.turned_pitch = kPi / 2;
  robot.tool_site = "tool";
  return robot;
}

}  // namespace etude::assets
