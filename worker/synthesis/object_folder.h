// SPDX-License-Identifier: Apache-2.0
// An object as files: meshes, texture, a MuJoCo model of its own, and facts for those who use it.
#pragma once

#include <cstdint>

#include "services/core/file.h"
#include "services/core/result.h"
#include "worker/synthesis/solid_object.h"

namespace etude::synthesis {

/// Of one of an object's files; a scene with it refuses larger ones.
inline constexpr std::uint64_t kLargestObjectFile = 64u << 20;

/// Writes visual.obj, visual.mtl, texture.png, collision_<i>.obj, <name>.xml and object.yaml into `folder`. The .xml is
/// a whole MuJoCo model: one body with a free joint, resting on z = 0, ready to be loaded or included.
/// @error kUnavailable: not written; some of the files may have been; kInvalidArgument: one is larger than `largest`
Status WriteObject(const SolidObject& object, const Path& folder, std::uint64_t largest = kLargestObjectFile);

}  // namespace etude::synthesis
