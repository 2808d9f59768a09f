// SPDX-License-Identifier: Apache-2.0
// Where things stand that no sentence names: around the objects, and never in the way of the task.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "worker/task/scene_sampling.h"

namespace etude::task {

/// What distractors have to keep clear of.
struct PlacedScene {
  const std::vector<sim::ObjectInfo>* infos = nullptr;  ///< of `objects`, in any order
  const std::vector<PlacedObject>* objects = nullptr;   ///< placed already, the obstacle too
  std::vector<std::string> roles = {};                  ///< those that the hand goes to
  double yaw = 0;                                       ///< +- rad about the vertical
  /// Whether the task can be done with the distractors where `checker` knows them.
  std::function<bool()> feasible = nullptr;
};

/// One place for each distractor: on the part of the table where objects stand, in columns of its own beside those
/// that the hand goes to, and before none of the others as the camera sees it.
/// `checker` knows the objects and gets the distractors; when nothing is returned it may know some of them.
/// @returns nothing when no arrangement was found within a fixed number of draws.
std::optional<std::vector<PlacedObject>> PlaceDistractors(const std::vector<sim::ObjectInfo>& distractors,
                                                          const PlacedScene& scene, collide::Checker& checker,
                                                          Rng& rng);

}  // namespace etude::task
