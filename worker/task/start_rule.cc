// SPDX-License-Identifier: Apache-2.0
#include "worker/task/start_rule.h"

#include <fmt/format.h>

#include "services/core/check.h"

namespace etude::task {

Status CheckPredicates(const TaskSpec& task) {
  const Cast cast{.target = "A", .reference = task.reference.needed ? "B" : "", .objects = {"A", "B"}};
  const auto check = [&](const char* key, const PredicateSpec& spec) -> Status {
    const auto made = MakePredicate(spec, cast);
    if (made) return {};
    return Fail(made.error().code, fmt::format("task '{}': {}: {}", task.name, key, made.error().message));
  };
  ETUDE_RETURN_IF_ERROR(check("success", task.success));
  if (task.latched) ETUDE_RETURN_IF_ERROR(check("latched", *task.latched));
  if (task.start.not_already) ETUDE_RETURN_IF_ERROR(check("start.not_already", *task.start.not_already));
  return {};
}

std::optional<std::string> Already(const TaskSpec& task, const Cast& cast, const std::vector<PlacedObject>& objects,
                                   const SceneGeometry& shapes) {
  if (!task.start.not_already) return std::nullopt;
  auto predicate = MakePredicate(*task.start.not_already, cast);
  ETUDE_CHECK(predicate, "task={} {}", task.name, predicate.error().message);
  Observation seen;
  for (const auto& object : objects)
    seen[object.name] = {.X_WO = object.X_WO,
                         .X_WO_start = object.X_WO,
                         .centre = shapes.Centre(object.name),
                         .half_extent = shapes.object(object.name).half_extent};
  if (!(*predicate)->Observe(seen)) return std::nullopt;
  return "already so: " + (*predicate)->Words();
}

}  // namespace etude::task
