// SPDX-License-Identifier: Apache-2.0
// From pictures and drawings to objects.
#pragma once

#include <cstdint>
#include <string>

#include "services/core/result.h"
#include "worker/synthesis/picture.h"
#include "worker/synthesis/solid_object.h"

namespace etude::synthesis {

/// The seed of the generated objects that scenes know by name.
inline constexpr std::uint64_t kObjectSeed = 1;

/// The whole of the pipeline: relief, smoothing, texture, foot, collision pieces, mass.
/// @error kInvalidArgument: no object in the picture, or a size or density that is not positive.
Result<SolidObject> ObjectFromPicture(ObjectFacts facts, const Picture& picture, const PlaceOptions& options = {});

/// Instance `index` of a built-in class, named "apple_07". A pure function of its arguments.
/// @param size_m  largest extent; 0: drawn from the sizes of the class, and so that a hand can grasp it
Result<SolidObject> DrawObject(const std::string& class_name, int index, std::uint64_t seed, double size_m = 0);

}  // namespace etude::synthesis
