// SPDX-License-Identifier: Apache-2.0
// Meshes on disk. assimp stays behind this header.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "worker/assets/mesh.h"

namespace etude::synthesis {

/// What a file holds: all of its meshes as one, in the file's units and axes.
struct FileMesh {
  assets::Mesh mesh;
  std::vector<std::uint8_t> picture;     ///< its texture, a PNG or JPEG file; empty when it has none
  std::vector<Eigen::Vector3d> palette;  ///< then red, green, blue in 0..1 of each material: uv are columns of this row
};

/// Reads .obj, .ply, .stl, .dae, .glb, .gltf and what else assimp knows. Polygons become triangles, equal vertices one,
/// the transforms of the file's nodes are applied, normals are made anew with creases at 60 degrees.
/// @error kNotFound; kCorrupt: not a mesh file, or one without faces; kInvalidArgument: flat or not finite.
/// Thread safety: concurrent calls.
Result<FileMesh> ReadMesh(const Path& path);

/// Writes a mesh with normals and texture coordinates as the suffix says: .obj, .ply, .stl, .dae or .glb.
/// @param texture  name of a picture beside it, which .obj, .dae and .glb refer to; empty: no material's picture
/// @error kInvalidArgument: another suffix, no faces or uneven lists; kUnavailable: not written.
Status WriteMesh(const Path& path, const assets::Mesh& mesh, const std::string& texture = {});

}  // namespace etude::synthesis
