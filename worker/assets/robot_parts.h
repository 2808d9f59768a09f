// SPDX-License-Identifier: Apache-2.0
// What the robots' descriptions share: housings, joints, frames. Private to worker/assets.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <numbers>
#include <string>
#include <vector>

#include "services/episode/pose.h"
#include "worker/assets/mesh.h"
#include "worker/assets/robot.h"

namespace etude::assets {

inline constexpr double kPi = std::numbers::pi;
inline const Eigen::Vector3d kX = Eigen::Vector3d::UnitX(), kY = Eigen::Vector3d::UnitY(),
                             kZ = Eigen::Vector3d::UnitZ();

/// Geoms of links, with the meshes that they need.
class Links {
 public:
  /// A housing: cylinder from `a` to `b` with rims softened by `bevel`, to look at and (plain) to collide with.
  std::string Housing(double radius, const Eigen::Vector3d& a, const Eigen::Vector3d& b, const char* material,
                      double bevel = 0.006);
  /// The same, only to look at.
  std::string Look(double radius, const Eigen::Vector3d& a, const Eigen::Vector3d& b, const char* material,
                   double bevel = 0.006);
  /// A cylinder to look at, a capsule to collide with.
  std::string Tube(double radius, const Eigen::Vector3d& a, const Eigen::Vector3d& b, const char* material);
  /// A capsule to look at and to collide with.
  std::string Limb(double radius, const Eigen::Vector3d& a, const Eigen::Vector3d& b, const char* material);
  /// Only to look at: a round body from `a` to `b` whose radius goes smoothly from `from` to `to`, its ends
  /// half spheres.
  std::string Taper(double from, double to, const Eigen::Vector3d& a, const Eigen::Vector3d& b, const char* material);
  /// Only to look at: a box with softened vertical edges, `half` sizes, at `pose`.
  std::string Block(const Eigen::Vector3d& half, double rounding, const Pose& pose, const char* material);
  /// The meshes of all that, once.
  std::vector<AssetFile> TakeFiles() { return std::move(files_); }

 private:
  std::string Show(const Mesh& mesh, const Pose& pose, const char* material);

  std::vector<AssetFile> files_;
};

/// `<joint>` about (or, `type="slide"`, along) `axis`, limited.
std::string Hinge(const std::string& name, const Eigen::Vector3d& axis, double low, double high, double armature,
                  const std::string& extra = {});
/// `<motor>` named like its joint, with its torque limit.
std::string Motor(const std::string& joint, double limit);
/// `<joint>` equality: `joint` follows `factor` times `driver`.
std::string Couple(const RobotModel::Coupled& coupled, const std::string& driver);
/// `<body>` to be closed by the caller.
std::string Open(const std::string& name, const Pose& pose);
/// `<site>` of the tool frame E.
std::string ToolSite(const Pose& pose);
/// `<inertial>` from the six numbers xx yy zz xy xz yz about the centre of mass.
std::string FullInertial(double mass, const Eigen::Vector3d& centre, const std::array<double, 6>& inertia);

Eigen::Quaterniond Turn(const Eigen::Vector3d& axis, double degrees);
Pose At(double x, double y, double z);

RobotModel MakeUr5();
RobotModel MakePanda();
RobotModel MakeJaco2();

}  // namespace etude::assets
