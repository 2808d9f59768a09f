// SPDX-License-Identifier: Apache-2.0
// From mesh files to objects, and many objects at once.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "worker/synthesis/object_folder.h"

namespace etude::synthesis {

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
