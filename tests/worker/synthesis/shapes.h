// SPDX-License-Identifier: Apache-2.0
// Bodies whose volume and inertia are known, for tests of what is worked out from meshes.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "services/core/rng.h"
#include "worker/assets/mesh.h"

namespace etude::synthesis {

inline assets::Mesh Box(const Eigen::Vector3d& half, const Eigen::Vector3d& centre) {
  assets::Mesh mesh = assets::Extrude(
      {{-half.x(), -half.z()}, {half.x(), -half.z()}, {half.x(), half.z()}, {-half.x(), half.z()}}, half.y(), false);
  for (Eigen::Vector3d& p : mesh.positions) p += centre;
  return mesh;
}

inline assets::Mesh Sphere(double radius, int rings) {
  std::vector<assets::ProfilePoint> profile;
  for (int i = 0; i <= rings; ++i) {
    const double angle = std::numbers::pi * i / rings;
    profile.push_back({i % rings == 0 ? 0 : radius * std::sin(angle), -radius * std::cos(angle), 0});
  }
  return assets::Lathe(profile, 2 * rings);
}

/// From z = 0 to `height`.
inline assets::Mesh Cylinder(double radius, double height, int segments) {
  return assets::Lathe({{0, 0, 1}, {radius, 0, 1}, {radius, height, 0}, {0, height, 0}}, segments);
}

/// How far a point is out of a convex mesh; negative inside.
inline double Outside(const assets::Mesh& hull, const Eigen::Vector3d& p) {
  double farthest = -std::numeric_limits<double>::infinity();
  for (const auto& f : hull.faces) {
    const Eigen::Vector3d& a = hull.positions[f[0]];
    const Eigen::Vector3d normal = (hull.positions[f[1]] - a).cross(hull.positions[f[2]] - a).normalized();
    farthest = std::max(farthest, normal.dot(p - a));
  }
  return farthest;
}

inline Eigen::Vector3d NormalVector(Rng& rng) {
  const double x = rng.Normal(), y = rng.Normal();
  return {x, y, rng.Normal()};
}

inline std::vector<Eigen::Vector3d> NormalPoints(int count, Rng& rng) {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < count; ++i) points.push_back(NormalVector(rng));
  return points;
}

}  // namespace etude::synthesis
