// SPDX-License-Identifier: Apache-2.0
// Kinova Jaco2 (j2n6s300): six joints with a curved wrist, and the three-finger hand KG-3.
//
// Sources of the numbers:
//   kinematics, joint limits, speeds, torques: Kinova, "JACO2 advanced specification guide" (lengths D1..D6,
//     e2, wrists bent by 60 degrees, classic Denavit-Hartenberg table; joint angles are the robot's own);
//     actuators K-75+ (peak 30.5 N m, 36 deg/s) and K-58 (peak 6.8 N m, 48 deg/s)
//   masses, centres of mass: Kinova's published description of the arm (kinova-ros)
//   hand: 0.727 kg, fingers hinged 0.1147 m ahead of the last actuator, proximal links of 44 mm
// Shapes and inertias are our own. The fingertips stay parallel to the hand while the fingers close, as in the
// hand's pinch grasp; in the robot they are underactuated.
#include <fmt/format.h>

#include <array>
#include <cmath>

#include "worker/assets/geom_writer.h"
#include "worker/assets/robot_parts.h"

namespace etude::assets {
namespace {

using Eigen::Vector3d;

// published lengths, m
constexpr double kD1 = 0.2755, kD2 = 0.4100, kD3 = 0.2073, kD4 = 0.0741, kD5 = 0.0741, kD6 = 0.1600, kE2 = 0.0098;
const double kHalfBend = 0.5 / std::cos(kPi / 6);  ///< sin(30 deg) / sin(60 deg)
/// From a wrist's actuator to where the axes meet, m.
const double kStub = kHalfBend * kD4;
const double kD4b = kD3 + kHalfBend * kD4, kD5b = kHalfBend * (kD4 + kD5), kD6b = kHalfBend * kD5 + kD6;

constexpr std::array<double, 6> kTorque{30.5, 30.5, 30.5, 6.8, 6.8, 6.8};
const std::array<double, 6> kSpeed{0.2 * kPi, 0.2 * kPi, 0.2 * kPi, 48 * kPi / 180, 48 * kPi / 180, 48 * kPi / 180};
// rotors seen through the gears (our estimate)
constexpr std::array<double, 6> kArmature{0.08, 0.08, 0.08, 0.03, 0.03, 0.03};
constexpr double kTurn = 2 * kPi;  ///< joints without stops: as far as we let them go
constexpr std::array<double, 6> kLow{-kTurn, 47 * kPi / 180, 19 * kPi / 180, -kTurn, -kTurn, -kTurn};
constexpr std::array<double, 6> kHigh{kTurn, 313 * kPi / 180, 341 * kPi / 180, kTurn, kTurn, kTurn};

// Hand, m, in the last link's frame: it points along -z, the thumb is at +y, two fingers at -y.
const double kHingeZ = -(kStub + 0.1147);
constexpr double kThumbY = 0.0313, kFingerY = 0.0271, kFingerX = 0.0223;
constexpr double kProximal = 0.044;
constexpr double kOpenAngle = 0.85;  ///< rad that open fingers lean outwards
constexpr double kPadIn = 0.0175;    ///< pads' faces from the middle when the fingers stand straight
constexpr double kPadThick = 0.004, kPadHalfLength = 0.0135, kPadAhead = 0.0213;
const double kClosed = kOpenAngle + std::asin(kPadIn / kProximal);  ///< rad
const double kToolZ = -(kD6b + 0.020);                              ///< E is 20 mm beyond the published end effector
constexpr double kGripTorque = 2.0, kFingerDamping = 0.35;          ///< N m of all three; N m s/rad each

constexpr const char *kCarbon = "jaco_carbon", *kShell = "jaco_shell", *kSilver = "jaco_silver";

std::string Joint(int i) { return "jaco_joint_" + std::to_string(i + 1); }

std::string OpenLink(int i, const std::string& name, const Pose& pose) {
  return Open(name, pose) + Hinge(Joint(i), i == 0 ? Vector3d(-kZ) : kZ, kLow[i], kHigh[i], kArmature[i]);
}

/// A silver ring about an actuator's axis, only to look at.
std::string Ring(Links& links, double radius, const Vector3d& at, const Vector3d& axis) {
  return links.Look(radius, at - 0.0035 * axis, at + 0.0035 * axis, kSilver, 0.001);
}

/// Base to forearm: opens four bodies.
std::string Proximal(Links& links) {
  std::string text = Open("base", At(0, -0.2, 0));
  text += CylinderInertial(0.46784, 0.04, 0.15, 0.1255 * kZ, kZ);
  text += links.Housing(0.072, 0.0 * kZ, 0.018 * kZ, kShell);
  text += links.Housing(0.046, 0.018 * kZ, 0.155 * kZ, kShell);

  text += OpenLink(0, "shoulder", {});
  text += CylinderInertial(0.7477, 0.04, 0.15, {0, 0, 0.2172}, kZ);
  text += Ring(links, 0.0475, 0.1585 * kZ, kZ);
  text += links.Housing(0.046, 0.157 * kZ, 0.245 * kZ, kShell, 0.012);
  text += links.Housing(0.044, kD1 * kZ - 0.052 * kY, kD1 * kZ + 0.052 * kY, kShell, 0.014);

  text += OpenLink(1, "arm", Pose{{0, 0, kD1}, Turn(kX, 90)} * Pose{Vector3d::Zero(), Turn(kZ, -90)});
  text += CylinderInertial(0.99, 0.04, 0.4, {0.2065, 0, 0}, kX);
  for (const double side : {-1.0, 1.0}) text += Ring(links, 0.043, side * 0.054 * kZ, kZ);
  text += links.Taper(0.042, 0.036, 0.03 * kX, 0.20 * kX, kCarbon);
  text += links.Taper(0.036, 0.040, 0.20 * kX, (kD2 - 0.02) * kX, kCarbon);
  text += GeomBetween("robot", "capsule", 0.042, 0.0 * kX, (kD2 - 0.02) * kX);
  text += links.Housing(0.042, kD2 * kX - 0.050 * kZ, kD2 * kX + 0.050 * kZ, kShell, 0.014);

  const double out = kStub - kD4b;  // -kD3: where the wrist begins
  text += OpenLink(2, "forearm", Pose{{kD2, 0, 0}, Turn(kX, 180)} * Pose{Vector3d::Zero(), Turn(kZ, 90)});
  text += CylinderInertial(0.6763, 0.03, 0.2, {0, 0.081, -kE2}, kY);
  for (const double side : {-1.0, 1.0}) text += Ring(links, 0.041, side * 0.052 * kZ, kZ);
  text += links.Taper(0.040, 0.033, {0, 0.02, -kE2 / 2}, {0, -out - 0.045, -kE2}, kCarbon);
  text += GeomBetween("robot", "capsule", 0.039, {0, 0, -kE2 / 2}, {0, -out - 0.042, -kE2});
  text += links.Look(0.0355, {0, -out - 0.04, -kE2}, {0, -out - 0.002, -kE2}, kShell);
  return text;
}

/// A wrist of two stubs that meet at `bend` (the next body's place) with 60 degrees between their axes.
std::string Wrist(Links& links, double from, const Pose& next) {
  const Vector3d beyond = next * (-kStub * kZ);
  std::string text = Ring(links, 0.0365, from * kZ, kZ);
  text += CylinderInertial(0.426367, 0.03, 0.09, next.p, (from * kZ - beyond).normalized());
  text += links.Look(0.0350, from * kZ, next.p + 0.006 * kZ, kShell);
  text += links.Limb(0.0345, (from - 0.02) * kZ, next.p, kShell);
  text += links.Limb(0.0345, next.p, next * (-(kStub - 0.034) * kZ), kShell);
  return text + links.Look(0.0350, next * (-0.012 * kZ), beyond, kShell);
}

/// Where a finger stands, and how its pad is cut. In its frame z points ahead and y outwards.
struct FingerShape {
  std::string name;
  Pose root;             ///< hinge in the hand
  double face;           ///< m from the hinge's line to the pad's face, inwards
  double x, half_width;  ///< of the pad, m
};

std::string Tip(const FingerShape& finger, Links& links) {
  const double y = -finger.face + kPadThick / 2;
  const Vector3d half(finger.half_width, (finger.face - kPadThick + 0.007) / 2, 0.019);
  const Pose shell = At(finger.x, 0.007 - half.y(), 0.0165);
  std::string text = BoxInertial(0.03, half, shell.p);
  text += links.Taper(0.0085, 0.0055, {finger.x / 2, -0.001, 0}, {finger.x, 0.001, 0.031}, kCarbon);
  text += Geom("robot", "box", {half.x(), half.y(), half.z()}, shell);
  text += links.Block({half.x(), half.y() * 0.75, half.z() * 0.93}, half.y() * 0.4,
                      {shell.p - 0.002 * kY, Eigen::Quaterniond::Identity()}, kCarbon);
  text += Geom("visual", "box", {finger.half_width, kPadThick / 2, kPadHalfLength}, At(finger.x, y, kPadAhead),
               "material=\"pad\"");
  // two halves, so that what is upright is touched at two heights and cannot pivot
  for (const double up : {-kPadHalfLength / 2, kPadHalfLength / 2})
    text += Geom("pad", "box", {finger.half_width, kPadThick / 2, kPadHalfLength / 2}, At(finger.x, y, kPadAhead + up));
  return text;
}

/// Two links: the proximal one leans outwards when open, the tip stays parallel to the hand.
std::string Finger(const FingerShape& finger, Links& links) {
  const auto hinge = [&](const std::string& joint, double low, double high, double damping) {
    return Hinge(joint, kX, low, high, 0.002,
                 fmt::format("damping=\"{}\" solreflimit=\"0.004 1\" solimplimit=\"0.99 0.999 0.001\"", damping));
  };
  const double lean = kOpenAngle * 180 / kPi;
  std::string text = Open(finger.name + "_base", finger.root * Pose{Vector3d::Zero(), Turn(kX, -lean)});
  text += hinge(finger.name + "_joint", 0, kClosed, kFingerDamping);
  text += CylinderInertial(0.03, 0.008, kProximal, kProximal / 2 * kZ, kZ);
  text += links.Limb(0.0075, 0.0 * kZ, kProximal * kZ, kShell);
  text += links.Look(0.0090, -0.009 * kX, 0.009 * kX, kSilver);
  text += Open(finger.name, {kProximal * kZ, Turn(kX, lean)});
  text += hinge(finger.name + "_tip_joint", -kClosed, 0, 0.02);
  return text + Tip(finger, links) + "</body>\n</body>\n";
}

std::string Hand(Links& links) {
  std::string text = CylinderInertial(0.547, 0.04, 0.10, {0, 0, -0.10}, kZ);
  text += Ring(links, 0.0365, -kStub * kZ, kZ);
  text += links.Taper(0.0350, 0.0430, -0.062 * kZ, -0.112 * kZ, kShell);
  text += links.Look(0.0350, -0.046 * kZ, -0.066 * kZ, kShell);
  text += links.Look(0.0432, -0.108 * kZ, -0.152 * kZ, kCarbon, 0.014);
  text += GeomBetween("robot", "cylinder", 0.0430, -0.048 * kZ, -0.152 * kZ);
  const Eigen::Quaterniond thumb = Turn(kY, 180), opposite = Turn(kX, 180);
  for (const FingerShape& finger :
       {FingerShape{"thumb", {{0, kThumbY, kHingeZ}, thumb}, kThumbY - kPadIn, 0, 0.0090},
        FingerShape{"index", {{kFingerX, -kFingerY, kHingeZ}, opposite}, kFingerY - kPadIn, -0.0045, 0.0070},
        FingerShape{"pinky", {{-kFingerX, -kFingerY, kHingeZ}, opposite}, kFingerY - kPadIn, 0.0045, 0.0070}})
    text += Finger(finger, links);
  // E: x back along the hand, y along the opening towards the thumb
  Eigen::Matrix3d R;
  R << 0, 0, -1, 0, 1, 0, 1, 0, 0;
  return text + ToolSite({{0, 0, kToolZ}, Eigen::Quaterniond(R)});
}

/// Wrists and hand: opens three bodies.
std::string Distal(Links& links) {
  const Pose bend1{{0, 0, -kD4b}, Turn(kX, 60)}, bend2{{0, 0, -kD5b}, Turn(kX, 60)};
  std::string text = OpenLink(3, "wrist_1", {{0, 0, -kE2}, Turn(kX, 90)}) + Wrist(links, -kD3, bend1);
  text += OpenLink(4, "wrist_2", bend1 * Pose{Vector3d::Zero(), Turn(kZ, -180)}) + Wrist(links, -kStub, bend2);
  text += OpenLink(5, "hand", bend2 * Pose{Vector3d::Zero(), Turn(kZ, 90)});
  return text + Hand(links);
}

void AddGripper(RobotModel& robot) {
  robot.gripper_joints = {"thumb_joint"};
  robot.coupled_joints = {{"index_joint", 1},
                          {"pinky_joint", 1},
                          {"thumb_tip_joint", -1},
                          {"index_tip_joint", -1},
                          {"pinky_tip_joint", -1}};
  for (const auto& coupled : robot.coupled_joints) robot.equality += Couple(coupled, "thumb_joint");
  robot.actuator += Motor("thumb_joint", 4);
  robot.gripper_closed = kClosed;
  robot.open_torque = -kGripTorque;
  robot.close_torque = kGripTorque;  // about 22 N against the thumb, half of it from each finger
  robot.finger_groups = {{"thumb", "thumb_base"}, {"index", "index_base", "pinky", "pinky_base"}};
}

std::string Material(const std::string& name, const std::string& rgb, double shine) {
  return fmt::format("<material name=\"{}\" rgba=\"{} 1\" specular=\"{}\" shininess=\"{}\"/>\n", name, rgb, shine,
                     shine);
}

}  // namespace

RobotModel MakeJaco2() {
  RobotModel robot;
  robot.name = "jaco2";
  robot.materials = Material(kCarbon, "0.17 0.18 0.20", 0.6) + Material(kShell, "0.30 0.31 0.34", 0.5) +
                    Material(kSilver, "0.78 0.79 0.81", 0.8) + Material("pad", "0.10 0.10 0.11", 0.1);
  Links links;
  robot.body = Proximal(links);
  robot.body += Distal(links);
  for (int i = 0; i < 7; ++i) robot.body += "</body>\n";
  robot.files = links.TakeFiles();
  for (int i = 0; i < 6; ++i) {
    robot.joints.push_back(Joint(i));
    robot.actuator += Motor(Joint(i), kTorque[i]);
  }
  robot.joint_speed.assign(kSpeed.begin(), kSpeed.end());
  // E at (0, 0.12, 0.33), hand down, elbow up
  robot.q_home = {1.8159981089952364, 3.2549223723441898,  1.3275024894147065,
                  -2.72896024988593,  -1.4382590016521417, 2.2286305126924155};
  robot.bodies = {"base",       "shoulder", "arm",        "forearm", "wrist_1",    "wrist_2", "hand",
                  "thumb_base", "thumb",    "index_base", "index",   "pinky_base", "pinky"};
  AddGripper(robot);
  robot.approach_pitch = kPi / 2;
  robot.turned_pitch = 0;
  robot.tool_site = "tool";
  return robot;
}

}  // namespace etude::assets
