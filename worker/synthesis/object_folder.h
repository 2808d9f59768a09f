// SPDX-License-Identifier: Apache-2.0
// An object as files: meshes, texture, a MuJoCo model of its own, and facts for those who use it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "worker/synthesis/mass.h"
#include "worker/synthesis/pieces.h"
#include "worker/synthesis/relief.h"

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
  int pieces = 0;                ///< collision_0.obj to collision_<pieces - 1>.obj; set by PlaceObject
  int faces = 0;                 ///< of visual.obj; set by PlaceObject

  template <class Visitor>
  void Visit(Visitor& v) {
    v("name", name);
    v("class", class_name);
    v("source", source);
    v("seed", seed);
    v("index", index);
    v("split", split);
    v("size_m", size_m);
    v("mass_kg", mass_kg);
    v("rest_height_m", rest_height_m);
    v("extent_m", extent_m);
    v("pieces", pieces);
    v("faces", faces);
  }
};

/// A body in its own frame: z up as it rests, origin in the middle of its box, m.
struct SolidObject {
  ObjectFacts facts;
  assets::Mesh visual;
  std::vector<std::uint8_t> texture;  ///< PNG
  std::vector<assets::Mesh> pieces;   ///< convex, to collide
  MassProperties mass;                ///< kg
};

/// Scales a mesh to `facts.size_m`, centres it and works out mass and collision pieces. The mass of a mesh that is not
/// closed is that of its pieces.
/// @param mesh     z up, any unit
/// @param hole     in the frame of the mesh
/// @param density  kg/m^3
/// @error kInvalidArgument: a size, density or mesh without volume.
Result<SolidObject> PlaceObject(ObjectFacts facts, assets::Mesh mesh, const std::optional<Hole>& hole, double density,
                                const PieceOptions& pieces = {});

/// Turns a body from the picture's frame (see RaiseRelief) so that z is up.
void StandUp(ReliefBody& body, View view);

/// Writes visual.obj, visual.mtl, texture.png, collision_<i>.obj, <name>.xml and object.yaml into `folder`. The .xml is
/// a whole MuJoCo model: one body with a free joint, resting on z = 0, ready to be loaded or included.
/// @error kUnavailable: not written; some of the files may have been.
Status WriteObject(const SolidObject& object, const Path& folder);

/// @error kNotFound, kInvalidArgument: no object.yaml, or not one of ours.
Result<ObjectFacts> ReadObjectFacts(const Path& folder);

}  // namespace etude::synthesis
