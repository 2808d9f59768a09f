// SPDX-License-Identifier: Apache-2.0
// Franka Emika Panda with its parallel hand.
//
// Sources of the numbers:
//   kinematics, joint limits, speeds, torques: Franka Control Interface documentation, "Robot and interface
//     specifications" (Denavit-Hartenberg table after Craig; flange 0.107 m; Panda limits)
//   masses, centres of mass, inertias: Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca, "Dynamic
//     identification of the Franka Emika Panda robot with retrieval of feasible parameters using
//     penalty-based optimization", IEEE RA-L 4(4), 2019, supplementary material
//   hand: Franka Hand product manual (0.73 kg, 80 mm stroke, 50 mm/s a finger, 30-70 N), fingers 0.0584 m and
//     fingertips' centre 0.1034 m from its flange
// Shapes are our own.
#include <array>

#include "worker/assets/geom_writer.h"
#include "worker/assets/robot_parts.h"

namespace etude::assets {
namespace {

using Eigen::Vector3d;

/// Body i turns about z of frame i; its frame stands in frame i - 1 by Rx(alpha) Tx(a) Tz(d).
struct Link {
  double a, d, alpha_deg;           ///< m, m, degrees
  double low, high, speed, torque;  ///< rad, rad, rad/s, N m
  double mass;                      ///< kg
  Vector3d centre;                  ///< m
  std::array<double, 6> inertia;    ///< kg m^2 about the centre: xx yy zz xy xz yz
  double armature;                  ///< kg m^2, the rotor seen through the gears (our estimate)
};
const std::array<Link, 7> kLinks{{
    {0,
     0.333,
     0,
     -2.8973,
     2.8973,
     2.175,
     87,
     4.970684,
     {0.003875, 0.002081, -0.04762},
     {0.70337, 0.70661, 0.0091170, -0.00013900, 0.0067720, 0.019169},
     0.10},
    {0,
     0,
     -90,
     -1.7628,
     1.7628,
     2.175,
     87,
     0.646926,
     {-0.003141, -0.02872, 0.003495},
     {0.0079620, 0.028110, 0.025995, -0.0039250, 0.010254, 0.00070400},
     0.10},
    {0,
     0.316,
     90,
     -2.8973,
     2.8973,
     2.175,
     87,
     3.228604,
     {0.027518, 0.039252, -0.066502},
     {0.037242, 0.036155, 0.010830, -0.0047610, -0.011396, -0.012805},
     0.10},
    {0.0825,
     0,
     90,
     -3.0718,
     -0.0698,
     2.175,
     87,
     3.587895,
     {-0.05317, 0.104419, 0.027454},
     {0.025853, 0.019552, 0.028323, 0.0077960, -0.0013320, 0.0086410},
     0.10},
    {-0.0825,
     0.384,
     -90,
     -2.8973,
     2.8973,
     2.61,
     12,
     1.225946,
     {-0.011953, 0.041065, -0.038437},
     {0.035549, 0.029474, 0.0086270, -0.0021170, -0.0040370, 0.00022900},
     0.05},
    {0,
     0,
     90,
     -0.0175,
     3.7525,
     2.61,
     12,
     1.666555,
     {0.060149, -0.014117, -0.010517},
     {0.0019640, 0.0043540, 0.0054330, 0.00010900, -0.0011580, 0.00034100},
     0.05},
    {0.088,
     0,
     90,
     -2.8973,
     2.8973,
     2.61,
     12,
     0.735522,
     {0.010517, -0.004252, 0.061597},
     {0.012516, 0.010027, 0.0048150, -0.00042800, -0.0011960, -0.00074100},
     0.05},
}};
constexpr double kFlange = 0.107;                     ///< m, along z of frame 7
constexpr double kFingerZ = 0.0584, kToolZ = 0.1034;  ///< m, along z of the hand
constexpr double kStroke = 0.04;                      ///< m, of each finger
constexpr double kFingerSpeed = 0.05, kGrip = 50;     ///< m/s; N of both fingers together
constexpr double kPadThick = 0.007, kPadHalfWidth = 0.0105, kPadHalfLength = 0.0092;

constexpr const char *kWhite = "panda_white", *kGrey = "panda_grey", *kDark = "panda_dark";

std::string Joint(int i) { return "panda_joint" + std::to_string(i + 1); }

std::string OpenLink(int i) {
  const Link& link = kLinks[i];
  const Eigen::Quaterniond q = Turn(kX, link.alpha_deg);
  return Open("link" + std::to_string(i + 1), {q * Vector3d(link.a, 0, link.d), q}) +
         Hinge(Joint(i), kZ, link.low, link.high, link.armature) + FullInertial(link.mass, link.centre, link.inertia);
}

/// Base to upper arm: opens base and links 1 to 3.
std::string Proximal(Links& links) {
  std::string text = Open("base", {{0, -0.3, 0}, Turn(kZ, 90)});
  text += CylinderInertial(2.9, 0.09, 0.14, 0.07 * kZ, kZ);  // stands still: only its pose matters
  const Vector3d foot(0.10, 0.092, 0.028);
  text += links.Block(foot, 0.03, At(-0.036, 0, foot.z()), kWhite);
  text += Geom("robot", "box", {foot.x(), foot.y(), foot.z()}, At(-0.036, 0, foot.z()));
  text += links.Taper(0.050, 0.040, {-0.075, 0, 0.05}, {-0.05, 0, 0.075}, kWhite);
  text += links.Housing(0.068, 0.05 * kZ, 0.138 * kZ, kWhite, 0.014);

  text += OpenLink(0);
  text += links.Look(0.0555, -0.197 * kZ, -0.188 * kZ, kGrey);
  text += links.Housing(0.059, -0.189 * kZ, -0.03 * kZ, kWhite);
  text += links.Housing(0.060, -0.074 * kY, 0.074 * kY, kWhite, 0.02);

  text += OpenLink(1);
  for (const double side : {-1.0, 1.0}) text += links.Look(0.046, side * 0.072 * kZ, side * 0.081 * kZ, kGrey);
  text += links.Limb(0.058, -0.02 * kY, -0.132 * kY, kWhite);
  text += links.Look(0.0565, -0.140 * kY, -0.190 * kY, kWhite);

  text += OpenLink(2);
  text += links.Look(0.0545, -0.128 * kZ, -0.118 * kZ, kGrey);
  text += links.Look(0.0565, -0.119 * kZ, -0.055 * kZ, kWhite);
  text += GeomBetween("robot", "cylinder", 0.0565, -0.122 * kZ, -0.055 * kZ);
  text += links.Limb(0.053, -0.058 * kZ, {0.06, 0, -0.012}, kWhite);
  text += links.Housing(0.056, {0.0825, -0.062, 0}, {0.0825, 0.062, 0}, kWhite, 0.016);
  return text;
}

/// Forearm and wrist: opens links 4 to 7.
std::string Distal(Links& links) {
  std::string text = OpenLink(3);
  for (const double side : {-1.0, 1.0}) text += links.Look(0.044, side * 0.060 * kZ, side * 0.069 * kZ, kGrey);
  text += links.Limb(0.054, {-0.012, 0.010, 0}, {-0.0825, 0.070, 0}, kWhite);
  text += links.Housing(0.0565, {-0.0825, 0.066, 0}, {-0.0825, 0.122, 0}, kWhite);

  text += OpenLink(4);
  text += links.Look(0.0545, -0.265 * kZ, -0.256 * kZ, kGrey);
  text += links.Housing(0.0565, -0.257 * kZ, -0.175 * kZ, kWhite);
  text += links.Taper(0.0565, 0.036, -0.178 * kZ, {0, 0.052, -0.075}, kWhite);
  text += GeomBetween("robot", "capsule", 0.050, -0.170 * kZ, {0, 0.044, -0.090});
  text += links.Limb(0.036, {0, 0.052, -0.085}, {0, 0.060, -0.020}, kWhite);
  text += links.Housing(0.049, {0, 0.036, 0}, {0, 0.096, 0}, kWhite, 0.016);

  text += OpenLink(5);
  text += links.Look(0.043, -0.090 * kZ, -0.102 * kZ, kGrey);
  text += links.Housing(0.050, -0.033 * kZ, 0.050 * kZ, kWhite, 0.016);
  text += links.Limb(0.043, {0.018, 0, 0.004}, {0.070, 0.014, 0}, kWhite);
  text += links.Housing(0.047, {0.088, -0.030, 0}, {0.088, 0.056, 0}, kWhite, 0.016);
  text += links.Look(0.036, {0.088, 0.055, 0}, {0.088, 0.062, 0}, kGrey);

  text += OpenLink(6);
  text += links.Look(0.043, 0.028 * kZ, 0.038 * kZ, kGrey);
  text += links.Housing(0.045, 0.036 * kZ, 0.085 * kZ, kWhite, 0.012);
  text += links.Housing(0.0315, 0.084 * kZ, kFlange * kZ, kDark);
  return text;
}

/// `s` is +1 for the finger at +y of the hand, -1 for the other.
std::string Finger(const std::string& name, const std::string& joint, double s) {
  std::string text = Open(name, At(0, 0, kFingerZ));
  const double damping = kGrip / 2 / kFingerSpeed;
  text += Hinge(joint, s * kY, 0, kStroke, 0.1,
                "type=\"slide\" damping=\"" + Numbers({damping}) + "\" solreflimit=\"0.004 1\"");
  text += BoxInertial(0.015, {0.0105, 0.011, 0.027}, {0, s * 0.012, 0.025});
  const Vector3d root(0.0105, 0.0105, 0.0175), tip(kPadHalfWidth, 0.0045, 0.0104);
  const Pose at_root = At(0, s * 0.0125, 0.0165), at_tip = At(0, s * (kPadThick + tip.y()), 0.0440);
  for (const auto& [half, pose] : {std::pair{root, at_root}, std::pair{tip, at_tip}}) {
    const std::vector<double> size{half.x(), half.y(), half.z()};
    text += Geom("visual", "box", size, pose, "material=\"panda_finger\"") + Geom("robot", "box", size, pose);
  }
  const double y = s * kPadThick / 2, z = kToolZ - kFingerZ;
  text += Geom("visual", "box", {kPadHalfWidth, kPadThick / 2, kPadHalfLength}, At(0, y, z), "material=\"pad\"");
  // two halves, so that what is upright is touched at two heights and cannot pivot
  for (const double up : {-kPadHalfLength / 2, kPadHalfLength / 2})
    text += Geom("pad", "box", {kPadHalfWidth, kPadThick / 2, kPadHalfLength / 2}, At(0, y, z + up));
  return text + "</body>\n";
}

std::string Hand(Links& links) {
  std::string text = Open("hand", {{0, 0, kFlange}, Turn(kZ, -45)});
  const Vector3d half(0.0315, 0.102, 0.030);
  text += BoxInertial(0.73, half, {0, 0, 0.030});
  text += links.Block(half, 0.028, At(0, 0, half.z() + 0.004), kWhite);
  text += links.Block({0.0285, 0.098, 0.004}, 0.026, At(0, 0, 0.0655), kDark);
  text += links.Look(0.034, 0.0 * kZ, 0.008 * kZ, kDark);
  text += Geom("robot", "box", {half.x(), half.y(), 0.0345}, At(0, 0, 0.0345));
  text += Finger("left_finger", "finger_joint1", +1) + Finger("right_finger", "finger_joint2", -1);
  // E: x back along the hand, y along the opening, so that the hand which faces +y and points down has it
  // along -x of the world
  Eigen::Matrix3d R;
  R << 0, 0, -1, 0, -1, 0, -1, 0, 0;
  return text + ToolSite({{0, 0, kToolZ}, Eigen::Quaterniond(R)}) + "</body>\n";
}

std::string Material(const std::string& name, const std::string& rgb, double shine) {
  return "<material name=\"" + name + "\" rgba=\"" + rgb + " 1\" specular=\"" + Numbers({shine}) + "\" shininess=\"" +
         Numbers({shine}) + "\"/>\n";
}

}  // namespace

RobotModel MakePanda() {
  RobotModel robot;
  robot.name = "panda";
  robot.materials = Material(kWhite, "0.84 0.85 0.87", 0.4) + Material(kGrey, "0.42 0.44 0.47", 0.4) +
                    Material(kDark, "0.16 0.17 0.19", 0.4) + Material("panda_finger", "0.70 0.71 0.74", 0.6) +
                    Material("pad", "0.20 0.20 0.21", 0.1);
  Links links;
  robot.body = Proximal(links);
  robot.body += Distal(links);
  robot.body += Hand(links);
  for (int i = 0; i < 8; ++i) robot.body += "</body>\n";
  robot.files = links.TakeFiles();
  robot.bodies = {"base"};
  for (int i = 0; i < 7; ++i) {
    robot.joints.push_back(Joint(i));
    robot.joint_speed.push_back(kLinks[i].speed);
    robot.actuator += Motor(Joint(i), kLinks[i].torque);
    robot.bodies.push_back("link" + std::to_string(i + 1));
  }
  robot.bodies.insert(robot.bodies.end(), {"hand", "left_finger", "right_finger"});
  // E at (0, 0.03, 0.36), hand down, elbow in the arm's plane
  robot.q_home = {0, -0.72225383920078401, 0, -2.6432144843744174, 0, 1.9209604042143065, kPi / 4};
  robot.gripper_joints = {"finger_joint1"};
  robot.coupled_joints = {{"finger_joint2", 1}};
  robot.equality = Couple(robot.coupled_joints[0], "finger_joint1");
  robot.actuator += Motor("finger_joint1", 70);
  robot.gripper_open = kStroke;
  robot.gripper_closed = 0;
  robot.open_torque = kGrip;
  robot.close_torque = -kGrip;  // 25 N a finger
  robot.finger_groups = {{"left_finger"}, {"right_finger"}};
  robot.approach_pitch = kPi / 2;
  robot.turned_pitch = kPi;  // the wrist ends before a level hand points away from the robot
  robot.tool_site = "tool";
  return robot;
}

}  // namespace etude::assets
