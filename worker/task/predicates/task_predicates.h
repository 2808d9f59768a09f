// SPDX-License-Identifier: Apache-2.0
// What a task's predicates name, and whether they can be made.
#pragma once

#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/spec/task_spec.h"

namespace etude::task {

/// Whether the predicates of a task can be made: their kinds, parameters and roles. An object may be named: whether a
/// scene has it is known where the scene is drawn.
/// @param objects  that may be named beside those that come with Etude: the campaign's own, by their names in scenes
/// @error kInvalidArgument: as MakePredicate, with the task's name and the key
Status CheckPredicates(const TaskSpec& task, const std::vector<std::string>& objects = {});

/// The objects that its predicates speak of by their own names, in no order and each as often as it is named.
/// @param objects  as CheckPredicates
std::vector<std::string> NamedObjects(const TaskSpec& task, const std::vector<std::string>& objects);
/// Those of one predicate.
std::vector<std::string> NamedObjects(const PredicateSpec& predicate, const std::vector<std::string>& objects);

}  // namespace etude::task
