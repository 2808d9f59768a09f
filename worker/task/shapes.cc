// SPDX-License-Identifier: Apache-2.0
#include "worker/task/shapes.h"

#include <algorithm>
#include <limits>
#include <numbers>

#include "services/core/check.h"

namespace etude::task {

double Support(const sim::Geometry& piece, const Pose& X_WG, const Eigen::Vector3d& direction) {
  using Shape = sim::Geometry::Shape;
  const Eigen::Vector3d d = X_WG.q.conjugate() * direction;  // in G
  const double centre = direction.dot(X_WG.p);
  switch (piece.shape) {
    case Shape::kBox:
      return centre + d.cwiseAbs().dot(piece.size);
    case Shape::kSphere:
      return centre + piece.size.x();
    case Shape::kCapsule:
      return centre + piece.size.x() + std::abs(d.z()) * piece.size.y();
    case Shape::kCylinder:
      return centre + piece.size.x() * d.head<2>().norm() + std::abs(d.z()) * piece.size.y();
    case Shape::kConvex: {
      double most = -std::numeric_limits<double>::infinity();
      for (const auto& vertex : piece.vertices) most = std::max(most, d.dot(vertex));
      return centre + most;
    }
  }
  return centre;
}

Eigen::Quaterniond LevelHand() { return FromEuler({std::numbers::pi, 0, std::numbers::pi / 2}); }

Eigen::Quaterniond TurnedHand() { return FromEuler({std::numbers::pi / 2, 0, std::numbers::pi / 2}); }

Shapes::Shapes(const sim::Scene& scene, sim::Kinematics& kinematics) : objects_(scene.objects()) {
  for (const auto& piece : scene.geometry()) pieces_[piece.body].push_back(piece);
  ahead_open_ = Ahead(scene, kinematics, 0);
  ahead_closed_ = Ahead(scene, kinematics, 1);
  base_y_ = kinematics.BodyPoses(scene.arm().q_home, 0, {scene.arm().bodies.front()})[0].p.y();
}

double Shapes::Ahead(const sim::Scene& scene, sim::Kinematics& kinematics, double gripper) const {
  const auto& arm = scene.arm();
  const Pose X_EW = kinematics.X_WE(arm.q_home).inverse();
  const Eigen::Vector3d forward = LevelHand().conjugate() * Eigen::Vector3d::UnitY();  // in E
  const auto poses = kinematics.BodyPoses(arm.q_home, gripper, arm.bodies);
  double ahead = -std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < arm.bodies.size(); ++i) {
    const auto pieces = pieces_.find(arm.bodies[i]);
    if (pieces == pieces_.end()) continue;
    for (const auto& piece : pieces->second)
      ahead = std::max(ahead, Support(piece, X_EW * poses[i] * piece.X_BG, forward));
  }
  ETUDE_CHECK(std::isfinite(ahead), "the arm has no collision pieces");
  return ahead;
}

const sim::ObjectInfo& Shapes::object(const std::string& name) const {
  const auto it =
      std::find_if(objects_.begin(), objects_.end(), [&](const auto& object) { return object.name == name; });
  ETUDE_CHECK(it != objects_.end(), "object={}", name);
  return *it;
}

Eigen::Vector3d Shapes::Centre(const std::string& name) const {
  const auto& info = object(name);
  return {0, 0, info.half_extent.z() - info.rest_height};
}

double Shapes::HeightOnTable(const std::string& name, const Eigen::Quaterniond& q_WO) const {
  const auto pieces = pieces_.find(name);
  ETUDE_CHECK(pieces != pieces_.end(), "object={}", name);
  double below = -std::numeric_limits<double>::infinity();
  for (const auto& piece : pieces->second) {
    const Pose X_WG = Pose{Eigen::Vector3d::Zero(), q_WO} * piece.X_BG;
    below = std::max(below, Support(piece, X_WG, -Eigen::Vector3d::UnitZ()));
  }
  return below;
}

}  // namespace etude::task
