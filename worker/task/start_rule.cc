// SPDX-License-Identifier: Apache-2.0
#include "worker/task/start_rule.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/spec/object_names.h"
#include "worker/task/predicates/kind.h"

namespace etude::task {
namespace {

// Names that no object has: a predicate cannot speak of them but by the roles.
constexpr const char* kTarget = "/target";
constexpr const char* kReference = "/reference";

/// Whether `word` is an object's own name there: not a word of the kind ("from: table"), nor a role.
bool IsObject(const std::string& kind, const std::string& parameter, const std::string& word) {
  const auto& kinds = PredicateKinds();
  const auto known = std::ranges::find(kinds, kind, &PredicateKind::name);
  if (known == kinds.end() || word == "target" || word == "reference" || word == "others") return false;
  const auto found = std::ranges::find(known->parameters, parameter, &PredicateParameter::name);
  return found != known->parameters.end() &&
         (found->type == PredicateParameter::Type::kObject || found->type == PredicateParameter::Type::kObjects);
}

/// Adds the known objects, and those of `own`, that the tree speaks of by their own names.
void AddNamed(const PredicateSpec& spec, const std::vector<std::string>& own, std::vector<std::string>& names) {
  for (const auto& [parameter, value] : spec.parameters)
    if (value.is_word() && IsObject(spec.kind, parameter, value.word) &&
        (CheckObjectName(value.word) || std::ranges::count(own, value.word) > 0))
      names.push_back(value.word);
  for (const PredicateSpec& child : spec.children) AddNamed(child, own, names);
}

}  // namespace

Status CheckPredicates(const TaskSpec& task, const std::vector<std::string>& objects) {
  const std::string reference = task.reference.needed ? kReference : "";
  const auto check = [&](const char* key, const PredicateSpec& spec) -> Status {
    Cast cast{.target = kTarget, .reference = reference, .objects = {kTarget, kReference}};
    AddNamed(spec, objects, cast.objects);
    const auto made = MakePredicate(spec, cast);
    if (made) return {};
    return Fail(made.error().code, fmt::format("task '{}': {}: {}", task.name, key, made.error().message));
  };
  ETUDE_RETURN_IF_ERROR(check("success", task.success));
  if (task.latched) ETUDE_RETURN_IF_ERROR(check("latched", *task.latched));
  if (task.start.not_already) ETUDE_RETURN_IF_ERROR(check("start.not_already", *task.start.not_already));
  return {};
}

std::vector<std::string> NamedObjects(const TaskSpec& task, const std::vector<std::string>& objects) {
  std::vector<std::string> names;
  AddNamed(task.success, objects, names);
  if (task.latched) AddNamed(*task.latched, objects, names);
  if (task.start.not_already) AddNamed(*task.start.not_already, objects, names);
  return names;
}

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
