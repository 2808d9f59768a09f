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

/// Whether the predicates of a task can be made: their kinds, parameters and roles. An object may be named: whether a
/// scene has it is known where the scene is drawn.
/// @param objects  that may be named beside those that come with Etude: the campaign's own, by their names in scenes
/// @error kInvalidArgument: as MakePredicate, with the task's name and the key
Status CheckPredicates(const TaskSpec& task, const std::vector<std::string>& objects = {});

/// The objects that its predicates speak of by their own names, in no order and each as often as it is named.
/// @param objects  as CheckPredicates
std::vector<std::string> NamedObjects(const TaskSpec& task, const std::vector<std::string>& objects);

/// What of `start.not_already` holds while the objects stand like this, nothing when none does.
/// @pre CheckPredicates(task)
/// @error kInvalidArgument: the rule names an object that is not among them
Result<std::optional<std::string>> Already(const TaskSpec& task, const Cast& cast,
                                           const std::vector<PlacedObject>& objects, const SceneGeometry& shapes);

}  // namespace etude::task
