// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/drawn_object.h"

#include <utility>

#include "services/core/rng.h"
#include "services/spec/object_names.h"
#include "worker/synthesis/generator.h"

namespace etude::synthesis {

Result<SolidObject> ObjectFromPicture(ObjectFacts facts, const Picture& picture, const PlaceOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(HeightfieldBody body, RaiseHeightfield(picture));
  StandUp(body, picture.view);
  ETUDE_ASSIGN_OR_RETURN(SolidObject object, PlaceObject(std::move(facts), std::move(body.mesh), body.hole, options));
  object.texture = TextureOf(picture);
  return object;
}

Result<SolidObject> DrawObject(const std::string& class_name, int index, std::uint64_t seed, double size_m) {
  ETUDE_ASSIGN_OR_RETURN(const ClassFacts known, FindClass(class_name));
  const auto number = static_cast<std::uint64_t>(index);
  ETUDE_ASSIGN_OR_RETURN(const Picture picture, Draw(class_name, MixSeed({seed, number}, "picture")));
  Rng rng(MixSeed({seed, number}, "size " + class_name));
  ObjectFacts facts{.name = GeneratedObject(class_name, index),
                    .class_name = class_name,
                    .source = "drawn",
                    .seed = seed,
                    .index = index,
                    .split = SplitOfInstance(index),
                    .size_m = size_m > 0 ? size_m : rng.Uniform(known.smallest_m, known.largest_m)};
  const PlaceOptions options{.density = known.density, .widest = size_m > 0 ? 0 : kWidestGrasp};
  return ObjectFromPicture(std::move(facts), picture, options);
}

}  // namespace etude::synthesis
