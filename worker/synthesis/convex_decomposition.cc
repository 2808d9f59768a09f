// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/convex_decomposition.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "worker/synthesis/hull.h"
#include "worker/synthesis/mass.h"

namespace etude::synthesis {
namespace {

using Eigen::Vector3d;

/// A half space: inside where the distance along the normal is at most the offset.
struct Plane {
  Vector3d normal;
  double offset;

  double Outside(const Vector3d& p) const { return normal.dot(p) - offset; }
};
using Cell = std::vector<Plane>;

/// Slabs of equal thickness along the longest axis of the mesh's box.
std::vector<Cell> Slices(const assets::Mesh& mesh, int count) {
  Vector3d low = mesh.positions[0], high = low;
  for (const Vector3d& p : mesh.positions) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  int axis = 0;
  (high - low).maxCoeff(&axis);
  std::vector<Cell> cells;
  for (int i = 0; i < count; ++i) {
    const double from = std::lerp(low[axis], high[axis], static_cast<double>(i) / count);
    const double to = std::lerp(low[axis], high[axis], (i + 1.0) / count);
    cells.push_back({{-Vector3d::Unit(axis), -from}, {Vector3d::Unit(axis), to}});
  }
  return cells;
}

/// Wedges of equal angle around the hole's axis.
std::vector<Cell> Sectors(const Hole& hole, int count) {
  const Vector3d u = hole.axis.unitOrthogonal(), v = hole.axis.cross(u);
  const auto side = [&](double angle, double sign) {  // the plane through the axis at that angle
    const Vector3d normal = sign * (-std::sin(angle) * u + std::cos(angle) * v);
    return Plane{normal, normal.dot(hole.centre)};
  };
  std::vector<Cell> cells;
  for (int i = 0; i < count; ++i)
    cells.push_back({side(2 * std::numbers::pi * i / count, -1), side(2 * std::numbers::pi * (i + 1) / count, 1)});
  return cells;
}

/// The part of a convex polygon inside of a half space.
std::vector<Vector3d> Clip(const std::vector<Vector3d>& polygon, const Plane& plane) {
  std::vector<Vector3d> kept;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vector3d &from = polygon[i], &to = polygon[(i + 1) % polygon.size()];
    const double a = plane.Outside(from), b = plane.Outside(to);
    if (a <= 0) kept.push_back(from);
    if ((a < 0 && b > 0) || (a > 0 && b < 0)) kept.push_back(from + a / (a - b) * (to - from));
  }
  return kept;
}

/// Corners of the mesh's faces, clipped to the cell.
std::vector<Vector3d> PointsIn(const assets::Mesh& mesh, const Cell& cell) {
  std::vector<Vector3d> points;
  for (const auto& face : mesh.faces) {
    std::vector<Vector3d> polygon{mesh.positions[face[0]], mesh.positions[face[1]], mesh.positions[face[2]]};
    for (const Plane& plane : cell) polygon = Clip(polygon, plane);
    points.insert(points.end(), polygon.begin(), polygon.end());
  }
  return points;
}

std::vector<assets::Mesh> HullsIn(const assets::Mesh& mesh, const std::vector<Cell>& cells, int count) {
  std::vector<assets::Mesh> pieces;
  for (const Cell& cell : cells) {
    const auto points = PointsIn(mesh, cell);
    if (points.empty()) continue;
    if (auto hull = FittedHull(points, count)) pieces.push_back(std::move(*hull));
  }
  return pieces;
}

double VolumeOf(const std::vector<assets::Mesh>& pieces) {
  double volume = 0;
  for (const auto& piece : pieces) volume += Integrate(piece).mass;
  return volume;
}

}  // namespace

std::vector<assets::Mesh> ConvexPieces(const assets::Mesh& mesh, const std::optional<Hole>& hole,
                                       const PieceOptions& options) {
  if (hole) return HullsIn(mesh, Sectors(*hole, options.sectors), options.points);
  const double body = Integrate(mesh).mass;
  std::vector<assets::Mesh> pieces;
  for (int count = 1; count <= options.slices; ++count) {
    pieces = HullsIn(mesh, Slices(mesh, count), options.points);
    if (VolumeOf(pieces) <= (1 + options.fill) * body) break;
  }
  return pieces;
}

}  // namespace etude::synthesis
