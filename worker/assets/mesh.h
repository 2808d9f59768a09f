// SPDX-License-Identifier: Apache-2.0
// Procedural triangle meshes: surfaces of revolution and extrusions, with normals and texture
// coordinates.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace etude::assets {

/// A triangle mesh; positions, normals and uv have equal length. Faces are counter-clockwise from
/// outside.
struct Mesh {
  std::vector<Eigen::Vector3d> positions;  ///< m
  std::vector<Eigen::Vector3d> normals;    ///< unit
  std::vector<Eigen::Vector2d> uv;         ///< (0, 0) is the first texel of the first row
  std::vector<std::array<int, 3>> faces;

  /// Adds a flat convex polygon, its corners counter-clockwise seen from outside.
  void AddPolygon(const std::vector<Eigen::Vector3d>& corners, const std::vector<Eigen::Vector2d>& uvs);
  void Append(const Mesh& other);
};

/// One point of a profile: radius and height (m), and the texture row there.
struct ProfilePoint {
  double radius = 0;
  double z = 0;
  double v = 0;
};

/// Surface of revolution about z of a profile that runs from bottom to top. Corners sharper than
/// 40 degrees stay sharp, others are shaded smooth. u runs once around, starting at +x,
/// counter-clockwise.
Mesh Lathe(const std::vector<ProfilePoint>& profile, int segments);

/// Prism along y, |y| <= half_length, of a convex polygon in (x, z), counter-clockwise seen from
/// -y.
/// @param smooth  shade the sides smooth;  uv spans the bounding box of each side seen from its
/// front
Mesh Extrude(const std::vector<Eigen::Vector2d>& polygon, double half_length, bool smooth);

/// MuJoCo's binary mesh format (.msh): four int32 counts, then float32 positions, normals, uv,
/// int32 faces.
std::vector<std::uint8_t> ToMsh(const Mesh& mesh);

}  // namespace etude::assets
