// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/support_polygon.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <tuple>
#include <utility>
#include <vector>

namespace etude::synthesis {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kPlanes = 24;            // heights tried
constexpr double kAlreadyFlat = 1e-3;  // of the height
constexpr double kFlatness = 0.01;     // what is left of heights below the plane: faces keep some area
constexpr double kAsLarge = 0.9;       // of the foot that pressing makes

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

/// The points' hull as half planes: what is inside has d . p <= reach.
struct Side {
  Vector2d direction;
  double reach;
};
std::vector<Side> SidesOf(const std::vector<Vector2d>& points) {
  constexpr int kDirections = 64;
  std::vector<Side> sides;
  for (int k = 0; k < kDirections; ++k) {
    const double angle = 2 * std::numbers::pi * k / kDirections;
    const Vector2d direction(std::cos(angle), std::sin(angle));
    sides.push_back({direction, Reach(points, direction)});
  }
  return sides;
}

/// How much larger a rectangle could be and still be inside, and the side that limits it.
std::pair<double, Vector2d> Fit(const std::vector<Side>& sides, const SupportPolygon& foot) {
  std::pair<double, Vector2d> tightest{std::numeric_limits<double>::infinity(), Vector2d::Zero()};
  for (const Side& side : sides) {
    const double fit = (side.reach - side.direction.dot(foot.centre)) / side.direction.cwiseAbs().dot(foot.half);
    if (fit < tightest.first) tightest = {fit, side.direction};
  }
  return tightest;
}

/// A rectangle within the points' hull, long along y: what pushes comes from there. Its middle starts in that of the
/// points' box and is moved away from the side that limits it, by less and less.
SupportPolygon FootWithin(const std::vector<Vector2d>& points) {
  if (points.empty()) return {};
  const Vector2d high(Reach(points, Vector2d::UnitX()), Reach(points, Vector2d::UnitY()));
  const Vector2d low(-Reach(points, -Vector2d::UnitX()), -Reach(points, -Vector2d::UnitY()));
  const std::vector<Side> sides = SidesOf(points);
  SupportPolygon foot{(low + high) / 2, Vector2d(0.55, 0.84).cwiseProduct(high - low) / 2};
  SupportPolygon best = foot;
  auto [most, towards] = Fit(sides, foot);
  for (double step = 0.1; step > 0.002; step *= 0.9) {
    foot.centre -= step * (high - low).maxCoeff() * towards;
    double fit = 0;
    std::tie(fit, towards) = Fit(sides, foot);
    if (fit > most + 0.02) {
      most = fit;
      best = foot;
    }
  }
  best.half *= std::clamp(most, 0.0, 1.0);
  return best;
}

}  // namespace

SupportPolygon FlattenSupport(assets::Mesh& mesh, const SupportOptions& options) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Vector3d& p : mesh.positions) {
    low = std::min(low, p.z());
    high = std::max(high, p.z());
  }
  const auto is_enough = [&](const SupportPolygon& foot) {
    return foot.half.y() >= options.least_half && foot.half.x() >= options.least_half / 2;
  };
  const SupportPolygon flat = FootWithin(Outline(mesh, low + kAlreadyFlat * (high - low)));
  if (is_enough(flat)) return flat;
  SupportPolygon foot = flat;
  double plane = low;
  for (int i = 1; i <= kPlanes && !is_enough(foot); ++i) {
    plane = low + options.deepest * (high - low) * i / kPlanes;
    foot = FootWithin(Outline(mesh, plane));
  }
  // a narrow body that stands flat has no larger foot further up
  if (const double area = flat.half.prod(); area > 0 && area >= kAsLarge * foot.half.prod()) return flat;
  for (Vector3d& p : mesh.positions)
    if (p.z() < plane) p.z() = plane - kFlatness * (plane - p.z());
  return foot;
}

}  // namespace etude::synthesis
