// SPDX-License-Identifier: Apache-2.0
// What the tasks ask for, as trees of predicates: one definition for demonstrations and rollouts (see judge.h).
#pragma once

#include "services/spec/predicate_spec.h"
#include "services/spec/task_name.h"

namespace etude::task {

inline constexpr double kDisturbedDistance = 0.02;  ///< m, another object moved

/// What a task asks for.
struct Criteria {
  PredicateSpec success;  ///< strict: a state, to be held for kDwell control steps
  /// Beside it, from the same rollout: for base tasks the authors' criterion, true once it held at any step. A task
  /// that has none in the paper (relations, rotate): done once, for a moment.
  PredicateSpec latched;
};

/// The criteria that its file says (deploy/tasks). Sources of the built-in ones: pick, push, put_down: the authors'
/// evaluation scripts (rise of 3 cm; 3 cm along +y; above 10 cm, and afterwards turned by 90 degrees about x and below
/// 8 cm, in either order; the turn counts either way round, theirs one way only).
Criteria CriteriaOf(const TaskName& task);

}  // namespace etude::task
