// SPDX-License-Identifier: Apache-2.0
// From pictures, drawings and mesh files to objects, one at a time and many at once.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "worker/synthesis/object_folder.h"
#include "worker/synthesis/picture.h"

namespace etude::synthesis {

/// Of the instances of a class so many, the first, are for training; the others for tests only.
inline constexpr int kTrainInstances = 3;

/// The whole of the pipeline: relief, smoothing, texture, collision pieces, mass.
/// @error kInvalidArgument: no object in the picture, or a size or density that is not positive.
Result<SolidObject> ObjectFromPicture(ObjectFacts facts, const Picture& picture, double density);

/// Instance `index` of a built-in class, named "apple_07". A pure function of its arguments.
/// @param size_m  largest extent; 0: drawn from the sizes of the class
Result<SolidObject> DrawObject(const std::string& class_name, int index, std::uint64_t seed, double size_m = 0);

enum class UpAxis { kY, kZ };

struct ImportOptions {
  std::string name;
  double size_m = 0.06;
  double density = 600;  ///< kg/m^3
  UpAxis up = UpAxis::kZ;
};
/// An object from a mesh file. Its texture is the file's, or a row of the colours of its materials.
/// @error those of ReadMesh and PlaceObject.
Result<SolidObject> ImportObject(const Path& file, const ImportOptions& options);

/// Makes objects and writes each into `out`/<name>, with so many threads; the files do not depend on how many.
/// Calls `made` after each, one call at a time, in the order in which they are done. Ends early when asked to stop.
/// @returns the facts of all, in the order of `makers`
/// @error the first maker's that failed; the others' objects may have been written.
using Maker = std::function<Result<SolidObject>()>;
Result<std::vector<ObjectFacts>> MakeObjects(const std::vector<Maker>& makers, const Path& out, int threads,
                                             const std::function<void(const ObjectFacts&)>& made);

}  // namespace etude::synthesis
