// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/mass.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <utility>

namespace etude::synthesis {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// Area vector of a face: along its normal, as long as its area.
Vector3d AreaVector(const assets::Mesh& mesh, const std::array<int, 3>& face) {
  const Vector3d& a = mesh.positions[face[0]];
  return (mesh.positions[face[1]] - a).cross(mesh.positions[face[2]] - a) / 2;
}

/// Inertia of second moments `c` (the integral of x x^T).
Matrix3d InertiaOf(const Matrix3d& c) { return c.trace() * Matrix3d::Identity() - c; }

/// For each vertex the first one at the same place.
std::vector<int> Welded(const assets::Mesh& mesh) {
  std::map<std::array<double, 3>, int> first;
  std::vector<int> welded(mesh.positions.size());
  for (std::size_t i = 0; i < welded.size(); ++i) {
    const Vector3d& p = mesh.positions[i];
    welded[i] = first.try_emplace({p.x(), p.y(), p.z()}, static_cast<int>(i)).first->second;
  }
  return welded;
}

}  // namespace

MassProperties Integrate(const assets::Mesh& mesh) {
  double volume = 0;
  Vector3d first = Vector3d::Zero();
  Matrix3d second = Matrix3d::Zero();
  if (mesh.positions.empty()) return {};

  // tetrahedra from each face to a point near the body, where sums of opposite signs cancel least
  const Vector3d origin = mesh.positions.front();
  for (const auto& face : mesh.faces) {
    const Vector3d a = mesh.positions[face[0]] - origin;
    const Vector3d b = mesh.positions[face[1]] - origin;
    const Vector3d c = mesh.positions[face[2]] - origin;
    const double v = a.dot(b.cross(c)) / 6;
    const Vector3d sum = a + b + c;
    volume += v;
    first += v / 4 * sum;
    second += v / 20 * (a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose());
  }
  if (volume == 0) return {};
  const Vector3d centre = first / volume;
  return {volume, origin + centre, InertiaOf(second - volume * centre * centre.transpose())};
}

MassProperties Sum(const std::vector<MassProperties>& parts) {
  MassProperties sum;
  for (const auto& part : parts) {
    sum.mass += part.mass;
    sum.centre += part.mass * part.centre;
  }
  if (sum.mass == 0) return {};
  sum.centre /= sum.mass;
  for (const auto& part : parts) {
    const Vector3d offset = part.centre - sum.centre;
    sum.inertia += part.inertia + part.mass * InertiaOf(offset * offset.transpose());
  }
  return sum;
}

PrincipalInertia Diagonalise(const Matrix3d& inertia) {
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(inertia);
  Matrix3d axes = solver.eigenvectors();
  if (axes.determinant() < 0) axes.col(2) *= -1;
  return {solver.eigenvalues(), Eigen::Quaterniond(axes).normalized()};
}

bool IsWatertight(const assets::Mesh& mesh) {
  const std::vector<int> welded = Welded(mesh);
  std::map<std::pair<int, int>, int> uses;
  for (const auto& face : mesh.faces)
    for (int k = 0; k < 3; ++k) ++uses[{welded[face[k]], welded[face[(k + 1) % 3]]}];
  return !uses.empty() && std::all_of(uses.begin(), uses.end(), [&](const auto& use) {
    const auto [from, to] = use.first;
    const auto back = uses.find({to, from});
    return use.second == 1 && from != to && back != uses.end() && back->second == 1;
  });
}

double SmallestFace(const assets::Mesh& mesh) {
  double smallest = std::numeric_limits<double>::infinity();
  for (const auto& face : mesh.faces) smallest = std::min(smallest, AreaVector(mesh, face).norm());
  return mesh.faces.empty() ? 0 : smallest;
}

namespace {

// For each face a vertex that stands for its part: the same for all that hang together.
std::vector<int> PartsOfFaces(const assets::Mesh& mesh) {
  std::vector<int> parent = Welded(mesh);
  const auto root = [&](int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  for (const auto& face : mesh.faces)
    for (int k = 1; k < 3; ++k) parent[root(face[k])] = root(face[0]);
  std::vector<int> parts;
  for (const auto& face : mesh.faces) parts.push_back(root(face[0]));
  return parts;
}

}  // namespace

int CountParts(const assets::Mesh& mesh) {
  const std::vector<int> parts = PartsOfFaces(mesh);
  return static_cast<int>(std::set<int>(parts.begin(), parts.end()).size());
}

void TurnOutward(assets::Mesh& mesh) {
  const auto turn = [](auto& face) { std::swap(face[1], face[2]); };
  if (Integrate(mesh).mass < 0) std::ranges::for_each(mesh.faces, turn);
  struct Part {
    double volume = 0;
    Eigen::AlignedBox3d box;
  };
  const std::vector<int> parts = PartsOfFaces(mesh);
  std::map<int, Part> known;
  for (std::size_t f = 0; f < parts.size(); ++f) {
    const auto& face = mesh.faces[f];
    const Vector3d &a = mesh.positions[face[0]], &b = mesh.positions[face[1]], &c = mesh.positions[face[2]];
    Part& part = known[parts[f]];
    part.volume += a.dot(b.cross(c)) / 6;
    part.box.extend(a).extend(b).extend(c);
  }
  const auto is_hollow = [&](const auto& item) {
    return std::ranges::any_of(known, [&](const auto& other) {
      return other.first != item.first && other.second.volume > 0 && other.second.box.contains(item.second.box);
    });
  };
  std::set<int> inward;
  for (const auto& item : known)
    if (item.second.volume < 0 && !is_hollow(item)) inward.insert(item.first);
  for (std::size_t f = 0; f < parts.size(); ++f)
    if (inward.contains(parts[f])) turn(mesh.faces[f]);
}

void ComputeNormals(assets::Mesh& mesh) {
  mesh.normals.assign(mesh.positions.size(), Vector3d::Zero());
  for (const auto& face : mesh.faces) {
    const Vector3d area = AreaVector(mesh, face);
    for (const int vertex : face) mesh.normals[vertex] += area;
  }
  for (Vector3d& normal : mesh.normals) normal = normal.norm() > 0 ? normal.normalized() : Vector3d::UnitZ().eval();
}

}  // namespace etude::synthesis
