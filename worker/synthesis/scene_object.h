// SPDX-License-Identifier: Apache-2.0
// Every object that a scene can have, by the name that a campaign gives it (see services/spec/object_names.h).
#pragma once

#include <string>

#include "services/core/file.h"
#include "services/core/result.h"
#include "worker/assets/object.h"
#include "worker/synthesis/solid_object.h"

namespace etude::synthesis {

/// A tabletop object or the basketball; a generated one, drawn when first asked for and kept; an imported one, read
/// from its folder each time. A pure function of the name (and of the folder's files). The model's name is
/// SceneName(name).
/// @error kInvalidArgument: unknown name, or a folder that is not an object's; kNotFound: no such folder.
/// Thread safety: concurrent calls.  Cost: 0.1 s for the first call of a generated one.
Result<assets::ObjectModel> MakeSceneObject(const std::string& name);

/// @param path  the folder, or the object.yaml in it
/// @error kNotFound, kInvalidArgument: no object.yaml, or not one of ours.
Result<ObjectFacts> ReadObjectFacts(const Path& path);

}  // namespace etude::synthesis
