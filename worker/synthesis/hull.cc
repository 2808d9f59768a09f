// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/hull.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <utility>

#include "services/core/rng.h"
#include "worker/synthesis/mass.h"

namespace etude::synthesis {
namespace {

using Eigen::Vector3d;
using Face = std::array<int, 3>;

constexpr double kJitter = 1e-6;  // of the points' size

/// The points' box: least corner and extent.
std::pair<Vector3d, Vector3d> BoxOf(const std::vector<Vector3d>& points) {
  Vector3d low = points[0], high = points[0];
  for (const Vector3d& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return {low, high - low};
}

/// Six times the volume of the tetrahedron from a face to p; positive when p is on the face's outer side.
double Above(const std::vector<Vector3d>& points, const Face& face, const Vector3d& p) {
  const Vector3d& a = points[face[0]];
  return (points[face[1]] - a).cross(points[face[2]] - a).dot(p - a);
}

template <class Score>
int Best(std::size_t count, const Score& score) {
  int best = 0;
  double highest = -std::numeric_limits<double>::infinity();
  for (int i = 0; i < static_cast<int>(count); ++i)
    if (const double s = score(i); s > highest) {
      highest = s;
      best = i;
    }
  return best;
}

/// Four points that span a large tetrahedron, as faces wound outwards; none when they are in a plane.
std::vector<Face> FirstFaces(const std::vector<Vector3d>& points, double size) {
  const auto& P = points;
  const int a = Best(P.size(), [&](int i) { return -P[i].x(); });
  const int b = Best(P.size(), [&](int i) { return (P[i] - P[a]).norm(); });
  const Vector3d along = (P[b] - P[a]).normalized();
  int c = Best(P.size(), [&](int i) { return (P[i] - P[a]).cross(along).norm(); });
  const Vector3d normal = (P[b] - P[a]).cross(P[c] - P[a]).normalized();
  const int d = Best(P.size(), [&](int i) { return std::abs(normal.dot(P[i] - P[a])); });
  if (std::abs(normal.dot(P[d] - P[a])) < 1e-5 * size) return {};
  Face base{a, b, c};
  if (Above(P, base, P[d]) > 0) std::swap(base[1], base[2]);
  return {base, {base[1], base[0], d}, {base[2], base[1], d}, {base[0], base[2], d}};
}

/// True when a point is farther than `margin` above one of the faces, and so no corner of them.
bool IsOutside(const std::vector<Vector3d>& points, int i, const std::vector<Face>& faces, double margin) {
  return std::any_of(faces.begin(), faces.end(), [&](const Face& face) {
    const Vector3d& a = points[face[0]];
    const Vector3d normal = (points[face[1]] - a).cross(points[face[2]] - a);
    return normal.dot(points[i] - a) > margin * normal.norm();
  });
}

/// Each place once, those far from the middle of the box first: what comes later is mostly inside of them.
std::vector<Vector3d> DistinctFarFirst(std::vector<Vector3d> points) {
  if (points.empty()) return points;
  const auto less = [](const Vector3d& a, const Vector3d& b) {
    return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
  };
  std::sort(points.begin(), points.end(), less);
  points.erase(std::unique(points.begin(), points.end()), points.end());
  const auto [low, extent] = BoxOf(points);
  const Vector3d middle = low + extent / 2;
  std::stable_sort(points.begin(), points.end(), [&](const Vector3d& a, const Vector3d& b) {
    return (a - middle).squaredNorm() > (b - middle).squaredNorm();
  });
  return points;
}

/// What is outside has a larger product with the normal.
struct Plane {
  Vector3d normal;
  double offset;
};
std::vector<Plane> PlanesOf(const assets::Mesh& mesh) {
  std::vector<Plane> planes;
  for (const auto& face : mesh.faces) {
    const Vector3d& a = mesh.positions[face[0]];
    const Vector3d normal = (mesh.positions[face[1]] - a).cross(mesh.positions[face[2]] - a).normalized();
    planes.push_back({normal, normal.dot(a)});
  }
  return planes;
}

/// Replaces the faces that see point `i` by a cone from the rim of what it sees.
void AddPoint(const std::vector<Vector3d>& points, int i, std::vector<Face>& faces) {
  const auto seen =
      std::partition(faces.begin(), faces.end(), [&](const Face& face) { return Above(points, face, points[i]) <= 0; });
  std::set<std::pair<int, int>> edges;
  for (auto face = seen; face != faces.end(); ++face)
    for (int k = 0; k < 3; ++k) edges.insert({(*face)[k], (*face)[(k + 1) % 3]});
  faces.erase(seen, faces.end());
  for (const auto& [from, to] : edges)
    if (!edges.contains({to, from})) faces.push_back({from, to, i});
}

}  // namespace

std::vector<Vector3d> FarthestPoints(const std::vector<Vector3d>& points, int count) {
  if (static_cast<int>(points.size()) <= count) return points;
  const auto [low, extent] = BoxOf(points);
  const Vector3d weight = extent.cwiseMax(1e-9).cwiseInverse();
  std::set<int> chosen;
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  for (int k = 0; k < count; ++k) {
    const double z = 1 - (2 * k + 1.0) / count, r = std::sqrt(1 - z * z);
    const Vector3d direction = weight.cwiseProduct(Vector3d(r * std::cos(golden * k), r * std::sin(golden * k), z));
    chosen.insert(Best(points.size(), [&](int i) { return direction.dot(points[i]); }));
  }
  std::vector<Vector3d> kept;
  for (const int i : chosen) kept.push_back(points[i]);
  return kept;
}

std::optional<assets::Mesh> ConvexHull(const std::vector<Vector3d>& given) {
  const std::vector<Vector3d> points = DistinctFarFirst(given);
  if (points.size() < 4) return std::nullopt;
  const auto [low, extent] = BoxOf(points);
  const double size = extent.norm();

  // no four of the moved points are in a plane, so that each is clearly above or below each face
  Rng rng(1);
  std::vector<Vector3d> moved = points;
  for (Vector3d& p : moved)
    for (int k = 0; k < 3; ++k) p[k] += kJitter * size * rng.Uniform(-1, 1);
  std::vector<Face> faces = FirstFaces(moved, size);
  if (faces.empty()) return std::nullopt;
  for (int i = 0; i < static_cast<int>(moved.size()); ++i)
    if (IsOutside(moved, i, faces, 4 * kJitter * size)) AddPoint(moved, i, faces);

  assets::Mesh mesh;
  std::vector<int> index(points.size(), -1);
  for (const Face& face : faces) {
    Face corners{};
    for (int k = 0; k < 3; ++k) {
      if (index[face[k]] < 0) {
        index[face[k]] = static_cast<int>(mesh.positions.size());
        mesh.positions.push_back(points[face[k]]);
        mesh.uv.emplace_back(0, 0);
      }
      corners[k] = index[face[k]];
    }
    mesh.faces.push_back(corners);
  }
  ComputeNormals(mesh);
  return mesh;
}

std::optional<assets::Mesh> FittedHull(const std::vector<Vector3d>& given, int count) {
  const std::vector<Vector3d> points = DistinctFarFirst(given);
  if (static_cast<int>(points.size()) <= count) return ConvexHull(points);
  std::vector<Vector3d> kept = FarthestPoints(points, 2 * count / 3);
  const double enough = 0.003 * BoxOf(points).second.norm();
  auto hull = ConvexHull(kept);
  while (hull && static_cast<int>(kept.size()) < count) {
    const std::vector<Plane> planes = PlanesOf(*hull);
    const auto outside = [&](int i) {
      double farthest = 0;
      for (const Plane& plane : planes) farthest = std::max(farthest, plane.normal.dot(points[i]) - plane.offset);
      return farthest;
    };
    const int worst = Best(points.size(), outside);
    if (outside(worst) < enough) break;
    kept.push_back(points[worst]);
    hull = ConvexHull(kept);
  }
  return hull;
}

}  // namespace etude::synthesis
