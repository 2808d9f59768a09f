// SPDX-License-Identifier: Apache-2.0
// An object ready to be simulated: what it looks like, what it collides with, what it weighs.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "worker/assets/mesh.h"
#include "worker/assets/object.h"
#include "worker/synthesis/convex_decomposition.h"
#include "worker/synthesis/heightfield.h"
#include "worker/synthesis/support_polygon.h"
#include "worker/synthesis/texture.h"

namespace etude::synthesis {

/// What object.yaml says.
struct ObjectFacts {
  std::string name;
  std::string class_name;
  std::string source;  ///< "drawn", "picture" or the name of the imported file
  std::uint64_t seed = 0;
  int index = 0;                 ///< in its class
  std::string split = "train";   ///< train | test
  double size_m = 0;             ///< largest extent
  double mass_kg = 0;            ///< set by PlaceObject
  double rest_height_m = 0;      ///< origin above the lowest point; set by PlaceObject
  std::vector<double> extent_m;  ///< along x, y, z; set by PlaceObject
  std::vector<double> centre_m;  ///< of mass; set by PlaceObject
  std::vector<double> inertia;   ///< xx, yy, zz, xy, xz, yz about it, kg m^2; set by PlaceObject
  std::vector<double> foot_m;    ///< x, y of the rectangle it stands on, half its sides; set by PlaceObject
  int pieces = 0;                ///< collision_0.obj to collision_<pieces - 1>.obj; set by PlaceObject
  int faces = 0;                 ///< of visual.obj; set by PlaceObject

  void Visit(auto& v) {
    v("name", name, "", "of the object and its folder");
    v("class", class_name, "", "what kind of thing it is");
    v("source", source, "", "drawn | picture | the file that was imported");
    v("seed", seed, "-", "that it was drawn from");
    v("index", index, "-", "in its class");
    v("split", split, "", "train | test");
    v("size_m", size_m, "m", "largest extent");
    v("mass_kg", mass_kg, "kg", "of all of it");
    v("rest_height_m", rest_height_m, "m", "origin above the lowest point");
    v("extent_m", extent_m, "m", "along x, y, z");
    v("centre_m", centre_m, "m", "of mass");
    v("inertia", inertia, "kg m^2", "about the centre of mass: xx, yy, zz, xy, xz, yz");
    v("foot_m", foot_m, "m", "x, y of the rectangle it stands on, half its sides");
    v("pieces", pieces, "-", "collision_0.obj to the last one");
    v("faces", faces, "-", "of visual.obj");
  }
};

/// A body in its own frame: z up as it stands, origin in the middle of its box, m.
struct SolidObject {
  ObjectFacts facts;
  assets::Mesh visual;
  Texture texture;
  std::vector<assets::Mesh> pieces;  ///< convex, to collide; they end a little above the foot, which is a thin box
};

/// Height of the foot's box: the pieces begin above it, so that a standing body touches the table with the box alone,
/// at four corners.
inline constexpr double kFootHeight = 0.004;

struct PlaceOptions {
  double density = 600;  ///< kg/m^3
  double widest = 0;     ///< m along x; an object that would be wider is made smaller; 0: as wide as it is
  PieceOptions pieces;
  SupportOptions foot;
};

/// Scales a mesh to `facts.size_m`, presses it flat below, centres it, works out mass and collision pieces. The mass of
/// a mesh that is not closed is that of its pieces.
/// @param mesh  z up, any unit
/// @param hole  in the frame of the mesh
/// @error kInvalidArgument: a size, density or mesh without volume.
Result<SolidObject> PlaceObject(ObjectFacts facts, assets::Mesh mesh, const std::optional<Hole>& hole,
                                const PlaceOptions& options = {});

/// Turns a body from the picture's frame (see RaiseHeightfield) so that z is up.
void StandUp(HeightfieldBody& body, View view);

/// How the elements of a body refer to what is around them.
struct BodyNames {
  std::string stem;          ///< begins the names of the meshes: STEM_visual, STEM_0, ..
  std::string material;      ///< to look at
  std::string class_prefix;  ///< before the scene's classes visual, object_round, object_foot
};
/// The content of the object's MJCF <body>: inertia, mesh to look at, pieces, foot.
std::string BodyElements(const ObjectFacts& facts, const BodyNames& names);

/// What the scene needs of an object in memory. @param name  of its body, a plain name
assets::ObjectModel ToSceneObject(const SolidObject& object, const std::string& name);

}  // namespace etude::synthesis
