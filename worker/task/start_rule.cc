// SPDX-License-Identifier: Apache-2.0
#include "worker/task/start_rule.h"

namespace etude::task {

Result<std::optional<std::string>> Already(const TaskSpec& task, const Cast& cast,
                                           const std::vector<PlacedObject>& objects, const SceneGeometry& shapes) {
  if (!task.start.not_already) return std::nullopt;
  ETUDE_ASSIGN_OR_RETURN(const auto predicate, MakePredicate(*task.start.not_already, cast));
  Observation seen;
  for (const auto& object : objects)
    seen[object.name] = {.X_WO = object.X_WO,
                         .X_WO_start = object.X_WO,
                         .centre = shapes.Centre(object.name),
                         .half_extent = shapes.object(object.name).half_extent};
  if (!predicate->Observe(seen)) return std::nullopt;
  return "already so: " + predicate->Words();
}

}  // namespace etude::task
