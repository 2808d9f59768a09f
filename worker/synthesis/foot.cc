// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/foot.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

namespace etude::synthesis {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kPlanes = 24;         // heights tried
constexpr double kFlatness = 0.01;  // what is left of heights below the plane: faces keep some area

/// Where the surface crosses the plane.
std::vector<Vector2d> Outline(const assets::Mesh& mesh, double plane) {
  std::vector<Vector2d> points;
  for (const auto& face : mesh.faces)
    for (int k = 0; k < 3; ++k) {
      const Vector3d &a = mesh.positions[face[k]], &b = mesh.positions[face[(k + 1) % 3]];
      if (a.z() < plane && b.z() >= plane)
        points.push_back((a + (plane - a.z()) / (b.z() - a.z()) * (b - a)).head<2>());
    }
  return points;
}

/// How far the points reach in a direction.
double Reach(const std::vector<Vector2d>& points, const Vector2d& direction) {
  double reach = -std::numeric_limits<double>::infinity();
  for (const Vector2d& p : points) reach = std::max(reach, direction.dot(p));
  return reach;
}

/// A rectangle within the points' hull, long along y: what pushes comes from there.
Foot FootWithin(const std::vector<Vector2d>& points) {
  if (points.empty()) return {};
  const Vector2d high(Reach(points, Vector2d::UnitX()), Reach(points, Vector2d::UnitY()));
  const Vector2d low(-Reach(points, -Vector2d::UnitX()), -Reach(points, -Vector2d::UnitY()));
  Foot foot{(low + high) / 2, Vector2d(0.55, 0.84).cwiseProduct(high - low) / 2};
  constexpr int kDirections = 64;
  double fits = 1;
  for (int k = 0; k < kDirections; ++k) {
    const double angle = 2 * std::numbers::pi * k / kDirections;
    const Vector2d direction(std::cos(angle), std::sin(angle));
    const double room = Reach(points, direction) - direction.dot(foot.centre);
    fits = std::min(fits, room / direction.cwiseAbs().dot(foot.half));
  }
  foot.half *= std::max(fits, 0.0);
  return foot;
}

}  // namespace

Foot PressFoot(assets::Mesh& mesh, const FootOptions& options) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Vector3d& p : mesh.positions) {
    low = std::min(low, p.z());
    high = std::max(high, p.z());
  }
  Foot foot;
  double plane = low;
  for (int i = 1; i <= kPlanes; ++i) {
    plane = low + options.deepest * (high - low) * i / kPlanes;
    foot = FootWithin(Outline(mesh, plane));
    if (foot.half.y() >= options.least_half && foot.half.x() >= options.least_half / 2) break;
  }
  for (Vector3d& p : mesh.positions)
    if (p.z() < plane) p.z() = plane - kFlatness * (plane - p.z());
  return foot;
}

}  // namespace etude::synthesis
