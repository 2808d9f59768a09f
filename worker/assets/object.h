// SPDX-License-Identifier: Apache-2.0
// The tabletop objects, by name.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "worker/assets/canvas.h"

namespace etude::assets {

/// A file that MJCF names, held in memory.
struct AssetFile {
  std::string name;  ///< "can.msh", "duck.obj" (a mesh) or "coke.tex", "duck.png" (a texture)
  std::vector<std::uint8_t> bytes;
  bool declared = false;  ///< whose <mesh> or <texture> element is written already
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

/// Contact of what can roll, and of the flat underside of a round object, which slides more easily than a grasped side
/// does: the attributes of MJCF geoms. The underside's count whatever it stands on.
inline constexpr const char* kRoundObjectContact =
    "contype=\"1\" conaffinity=\"3\" group=\"3\" condim=\"6\" friction=\"0.9 0.02 0.001\" solref=\"0.006 1\" "
    "solimp=\"0.95 0.99 0.001\" rgba=\"0.4 0.4 0.9 0.5\"";
inline constexpr const char* kFootContact =
    "contype=\"1\" conaffinity=\"3\" group=\"3\" condim=\"4\" priority=\"1\" friction=\"0.4 0.01 0.0001\" "
    "solref=\"0.006 1\" solimp=\"0.95 0.99 0.001\" rgba=\"0.4 0.9 0.9 0.5\"";

/// cube, coke, pepsi, milk, bread, bottle
const std::vector<std::string>& KnownObjects();
/// One of those, or the basketball that stands in the way of others.
/// @error kInvalidArgument: unknown name; the message has the nearest known one
Result<ObjectModel> MakeObject(const std::string& name);

/// The basketball's shape, weight and seams in another colour.
ObjectModel MakeBall(const std::string& name, const Color& colour);
/// Round the circle of hues with the number, in two depths; one of them is nearly the basketball's. @pre number >= 0
Color BallColour(int number);

/// Who makes the objects of a scene; MakeObject is the least of them.
using ObjectMaker = std::function<Result<ObjectModel>(const std::string& name)>;

}  // namespace etude::assets
