// SPDX-License-Identifier: Apache-2.0
#include "worker/assets/mesh.h"

#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <numbers>

#include "services/core/check.h"

namespace etude::assets {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

const double kCreaseCosine = std::cos(40.0 * std::numbers::pi / 180);

/// Normal (radius, z) of each profile segment; a lathe's outside is to the right of "upwards".
std::vector<Vector2d> SegmentNormals(const std::vector<ProfilePoint>& profile) {
  std::vector<Vector2d> normals;
  for (std::size_t i = 0; i + 1 < profile.size(); ++i) {
    const Vector2d along(profile[i + 1].radius - profile[i].radius, profile[i + 1].z - profile[i].z);
    ETUDE_CHECK(along.norm() > 0, "profile point {} is repeated", i);
    normals.push_back(Vector2d(along.y(), -along.x()).normalized());
  }
  return normals;
}

/// The normal that segment `own` shows at its end shared with `other`: shared when the corner is
/// blunt.
Vector2d Smooth(const Vector2d& own, const Vector2d* other) {
  if (!other || own.dot(*other) < kCreaseCosine) return own;
  return (own + *other).normalized();
}

/// The two flat ends of a prism; the texture spans the polygon's bounding box.
void AddEnds(const std::vector<Vector2d>& polygon, double half_length, const Vector2d& low, const Vector2d& span,
             Mesh& mesh) {
  std::vector<Vector3d> front, back;
  std::vector<Vector2d> front_uv, back_uv;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vector2d &p = polygon[i], &q = polygon[polygon.size() - 1 - i];
    front.emplace_back(p.x(), -half_length, p.y());
    front_uv.emplace_back((p.x() - low.x()) / span.x(), 1 - (p.y() - low.y()) / span.y());
    back.emplace_back(q.x(), half_length, q.y());
    back_uv.emplace_back(1 - (q.x() - low.x()) / span.x(), 1 - (q.y() - low.y()) / span.y());
  }
  mesh.AddPolygon(front, front_uv);
  mesh.AddPolygon(back, back_uv);
}

void Put(std::vector<std::uint8_t>& bytes, float value) {
  std::uint8_t raw[4];
  std::memcpy(raw, &value, 4);
  bytes.insert(bytes.end(), raw, raw + 4);
}

void Put(std::vector<std::uint8_t>& bytes, std::int32_t value) {
  std::uint8_t raw[4];
  std::memcpy(raw, &value, 4);
  bytes.insert(bytes.end(), raw, raw + 4);
}

}  // namespace

void Mesh::AddPolygon(const std::vector<Vector3d>& corners, const std::vector<Vector2d>& uvs) {
  ETUDE_CHECK(corners.size() >= 3 && corners.size() == uvs.size());
  const int first = static_cast<int>(positions.size());
  const Vector3d normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized();
  for (std::size_t i = 0; i < corners.size(); ++i) {
    positions.push_back(corners[i]);
    normals.push_back(normal);
    uv.push_back(uvs[i]);
  }
  for (int i = 1; i + 1 < static_cast<int>(corners.size()); ++i) faces.push_back({first, first + i, first + i + 1});
}

void Mesh::Append(const Mesh& other) {
  const int first = static_cast<int>(positions.size());
  positions.insert(positions.end(), other.positions.begin(), other.positions.end());
  normals.insert(normals.end(), other.normals.begin(), other.normals.end());
  uv.insert(uv.end(), other.uv.begin(), other.uv.end());
  for (const auto& face : other.faces) faces.push_back({face[0] + first, face[1] + first, face[2] + first});
}

Mesh Lathe(const std::vector<ProfilePoint>& profile, int segments) {
  ETUDE_CHECK(profile.size() >= 2 && segments >= 3);
  const std::vector<Vector2d> normals = SegmentNormals(profile);
  Mesh mesh;
  for (std::size_t i = 0; i < normals.size(); ++i) {
    const Vector2d lower = Smooth(normals[i], i > 0 ? &normals[i - 1] : nullptr);
    const Vector2d upper = Smooth(normals[i], i + 1 < normals.size() ? &normals[i + 1] : nullptr);
    const int first = static_cast<int>(mesh.positions.size());
    for (int k = 0; k <= segments; ++k) {
      const double u = static_cast<double>(k) / segments;
      // the seam's two columns must be the same points to the last bit
      const double angle = 2 * std::numbers::pi * (k % segments) / segments;
      const double c = std::cos(angle), s = std::sin(angle);
      for (const bool top : {false, true}) {
        const ProfilePoint& point = profile[i + top];
        const Vector2d& n = top ? upper : lower;
        mesh.positions.emplace_back(point.radius * c, point.radius * s, point.z);
        mesh.normals.emplace_back(n.x() * c, n.x() * s, n.y());
        mesh.uv.emplace_back(u, point.v);
      }
    }
    for (int k = 0; k < segments; ++k) {
      const int a = first + 2 * k, b = a + 2;  // a, b: lower; a + 1, b + 1: upper
      if (profile[i].radius > 0) mesh.faces.push_back({a, b, b + 1});
      if (profile[i + 1].radius > 0) mesh.faces.push_back({a, b + 1, a + 1});
    }
  }
  return mesh;
}

Mesh Extrude(const std::vector<Vector2d>& polygon, double half_length, bool smooth) {
  const int n = static_cast<int>(polygon.size());
  ETUDE_CHECK(n >= 3 && half_length > 0);
  Vector2d low = polygon[0], high = polygon[0];
  for (const Vector2d& p : polygon) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Vector2d span = high - low;
  const auto row = [&](const Vector2d& p) { return (high.y() - p.y()) / span.y(); };
  Mesh mesh;
  AddEnds(polygon, half_length, low, span, mesh);
  const auto outward = [&](int i) {  // of edge i -> i + 1, in (x, z)
    const Vector2d along = polygon[(i + 1) % n] - polygon[i];
    return Vector2d(along.y(), -along.x()).normalized();
  };
  for (int i = 0; i < n; ++i) {
    const Vector2d &p = polygon[i], &q = polygon[(i + 1) % n];
    const Vector2d own = outward(i), before = outward((i + n - 1) % n), after = outward((i + 1) % n);
    const Vector2d at_p = smooth ? Smooth(own, &before) : own;
    const Vector2d at_q = smooth ? Smooth(own, &after) : own;
    const int first = static_cast<int>(mesh.positions.size());
    mesh.AddPolygon({{p.x(), -half_length, p.y()},
                     {p.x(), half_length, p.y()},
                     {q.x(), half_length, q.y()},
                     {q.x(), -half_length, q.y()}},
                    {{0, row(p)}, {1, row(p)}, {1, row(q)}, {0, row(q)}});
    for (int k = 0; k < 4; ++k) {
      const Vector2d& normal = k < 2 ? at_p : at_q;
      mesh.normals[first + k] = {normal.x(), 0, normal.y()};
    }
  }
  return mesh;
}

std::vector<std::uint8_t> ToMsh(const Mesh& mesh) {
  const auto count = static_cast<std::int32_t>(mesh.positions.size());
  ETUDE_CHECK(mesh.normals.size() == mesh.positions.size() && mesh.uv.size() == mesh.positions.size());
  std::vector<std::uint8_t> bytes;
  bytes.reserve(16 + count * 32 + mesh.faces.size() * 12);
  for (const std::int32_t n : {count, count, count, static_cast<std::int32_t>(mesh.faces.size())}) Put(bytes, n);
  for (const auto* list : {&mesh.positions, &mesh.normals})
    for (const Vector3d& value : *list)
      for (int k = 0; k < 3; ++k) Put(bytes, static_cast<float>(value[k]));
  for (const Vector2d& value : mesh.uv)
    for (int k = 0; k < 2; ++k) Put(bytes, static_cast<float>(value[k]));
  for (const auto& face : mesh.faces)
    for (const int index : face) Put(bytes, static_cast<std::int32_t>(index));
  return bytes;
}

}  // namespace etude::assets
