// SPDX-License-Identifier: Apache-2.0
#include "worker/assets/robot_parts.h"

#include <fmt/format.h>

#include <cmath>

#include "worker/assets/geom_writer.h"

namespace etude::assets {

using Eigen::Vector3d;

namespace {

/// Quarter circle of the profile about (0, z): from the axis to the rim or back.
void AddCap(std::vector<ProfilePoint>& profile, double radius, double z, int sign) {
  constexpr int kSteps = 5;
  for (int i = 0; i < kSteps; ++i) {
    const int step = sign < 0 ? i : kSteps - 1 - i;
    const double angle = kPi / 2 * step / kSteps;
    profile.push_back({radius * std::sin(angle), z + sign * radius * std::cos(angle), sign < 0 ? 0.0 : 1.0});
  }
}

/// Point of a rounded rim: angle 0 on the end's face, pi/2 on the side.
ProfilePoint Rim(double radius, double half, double cut, double angle, int sign) {
  return {radius - cut + cut * std::sin(angle), sign * (half - cut + cut * std::cos(angle)), sign < 0 ? 0.0 : 1.0};
}

}  // namespace

std::string Links::Show(const Mesh& mesh, const Pose& pose, const char* material) {
  const std::string name = fmt::format("link_{}", files_.size());
  files_.push_back({name + ".msh", ToMsh(mesh)});
  return Geom("visual", "mesh", {}, pose, fmt::format("mesh=\"{}\" material=\"{}\"", name, material));
}

std::string Links::Housing(double radius, const Vector3d& a, const Vector3d& b, const char* material, double bevel) {
  return Look(radius, a, b, material, bevel) + GeomBetween("robot", "cylinder", radius, a, b);
}

std::string Links::Look(double radius, const Vector3d& a, const Vector3d& b, const char* material, double bevel) {
  const double half = (b - a).norm() / 2, cut = std::min(bevel, half * 0.5);
  std::vector<ProfilePoint> profile{{0, -half, 0}, {radius - cut, -half, 0}};
  // a small bevel is one step, a large one is round
  const int steps = cut > 0.01 ? 4 : 1;
  for (int i = 1; i <= steps; ++i) profile.push_back(Rim(radius, half, cut, kPi / 2 * i / steps, -1));
  for (int i = steps; i >= 1; --i) profile.push_back(Rim(radius, half, cut, kPi / 2 * i / steps, +1));
  profile.insert(profile.end(), {{radius - cut, half, 1}, {0, half, 1}});
  return Show(Lathe(profile, 24), {(a + b) / 2, AlongAxis(b - a)}, material);
}

std::string Links::Tube(double radius, const Vector3d& a, const Vector3d& b, const char* material) {
  return GeomBetween("visual", "cylinder", radius, a, b, fmt::format("material=\"{}\"", material)) +
         GeomBetween("robot", "capsule", radius, a, b);
}

std::string Links::Limb(double radius, const Vector3d& a, const Vector3d& b, const char* material) {
  return Taper(radius, radius, a, b, material) + GeomBetween("robot", "capsule", radius, a, b);
}

std::string Links::Taper(double from, double to, const Vector3d& a, const Vector3d& b, const char* material) {
  constexpr int kRings = 8;
  const double half = (b - a).norm() / 2;
  std::vector<ProfilePoint> profile;
  AddCap(profile, from, -half, -1);
  for (int i = 0; i <= kRings; ++i) {
    const double f = static_cast<double>(i) / kRings, ease = f * f * (3 - 2 * f);
    profile.push_back({from + (to - from) * ease, -half + 2 * half * f, f});
  }
  AddCap(profile, to, half, +1);
  return Show(Lathe(profile, 24), {(a + b) / 2, AlongAxis(b - a)}, material);
}

std::string Links::Block(const Vector3d& half, double rounding, const Pose& pose, const char* material) {
  constexpr int kSteps = 4;
  // Extrude makes a prism along y of a polygon in (x, z): the polygon is the block's outline in (x, y)
  std::vector<Eigen::Vector2d> outline;
  for (int corner = 0; corner < 4; ++corner) {
    const Eigen::Vector2d centre((corner == 0 || corner == 3 ? 1 : -1) * (half.x() - rounding),
                                 (corner < 2 ? 1 : -1) * (half.y() - rounding));
    for (int i = 0; i <= kSteps; ++i) {
      const double angle = kPi / 2 * (corner + static_cast<double>(i) / kSteps);
      outline.push_back(centre + rounding * Eigen::Vector2d(std::cos(angle), std::sin(angle)));
    }
  }
  return Show(Extrude(outline, half.z(), true), pose * Pose{Vector3d::Zero(), Turn(kX, -90)}, material);
}

std::string Hinge(const std::string& name, const Vector3d& axis, double low, double high, double armature,
                  const std::string& extra) {
  return fmt::format("<joint name=\"{}\" axis=\"{}\" range=\"{} {}\" armature=\"{}\"{}{}/>\n", name, Numbers(axis), low,
                     high, armature, extra.empty() ? "" : " ", extra);
}

std::string Motor(const std::string& joint, double limit) {
  return fmt::format("<motor name=\"{0}\" joint=\"{0}\" ctrlrange=\"{1} {2}\"/>\n", joint, -limit, limit);
}

std::string Couple(const RobotModel::Coupled& coupled, const std::string& driver) {
  return fmt::format(
      "<joint joint1=\"{}\" joint2=\"{}\" polycoef=\"0 {} 0 0 0\" "
      "solref=\"0.004 1\" solimp=\"0.98 0.999 0.001\"/>\n",
      coupled.joint, driver, coupled.factor);
}

std::string Open(const std::string& name, const Pose& pose) {
  return fmt::format("<body name=\"{}\"{}>\n", name, PoseAttributes(pose));
}

std::string ToolSite(const Pose& pose) {
  return fmt::format("<site name=\"tool\"{} size=\"0.004\" group=\"4\"/>\n", PoseAttributes(pose));
}

std::string FullInertial(double mass, const Vector3d& centre, const std::array<double, 6>& inertia) {
  return fmt::format("<inertial mass=\"{}\" pos=\"{}\" fullinertia=\"{}\"/>\n", mass, Numbers(centre),
                     Numbers(std::vector<double>(inertia.begin(), inertia.end())));
}

Eigen::Quaterniond Turn(const Vector3d& axis, double degrees) {
  return Eigen::Quaterniond(Eigen::AngleAxisd(degrees * kPi / 180, axis));
}

Pose At(double x, double y, double z) { return {{x, y, z}, Eigen::Quaterniond::Identity()}; }

}  // namespace etude::assets
