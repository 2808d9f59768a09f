// SPDX-License-Identifier: Apache-2.0
// The tabletop objects, by name.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "services/core/result.h"

namespace etude::assets {

/// A file that MJCF names, held in memory.
struct AssetFile {
  std::string name;  ///< "can.msh" (a mesh) or "coke.tex" (a texture)
  std::vector<std::uint8_t> bytes;
};

/// One free body of the scene. Its frame stands upright; x, y through the middle of the AABB.
struct ObjectModel {
  std::string name;
  Eigen::Vector3d half_extent = Eigen::Vector3d::Zero();  ///< m, of the upright AABB
  double rest_height = 0;                                 ///< body origin above the lowest point, m
  double mass = 0;                                        ///< kg
  std::string materials;                                  ///< MJCF <material> elements
  std::string geoms;             ///< MJCF: class "visual" to look at, class "object" to collide
  std::vector<AssetFile> files;  ///< meshes and textures; shared names have equal bytes
};

/// cube, coke, pepsi, milk, bread, bottle
const std::vector<std::string>& KnownObjects();
/// @error kInvalidArgument: unknown name; the message has the nearest known one
Result<ObjectModel> MakeObject(const std::string& name);

}  // namespace etude::assets
