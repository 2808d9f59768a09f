// SPDX-License-Identifier: Apache-2.0
// Scenes in which a task may not start because what it asks for is the case already.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/spec/task_spec.h"
#include "worker/task/geometry/scene_geometry.h"
#include "worker/task/predicates/predicate.h"
#include "worker/task/scene_sampling.h"

namespace etude::task {

/// What of `start.not_already` holds while the objects stand like this, nothing when none does.
/// @pre CheckPredicates(task)
/// @error kInvalidArgument: the rule names an object that is not among them
Result<std::optional<std::string>> Already(const TaskSpec& task, const Cast& cast,
                                           const std::vector<PlacedObject>& objects, const SceneGeometry& shapes);

}  // namespace etude::task
