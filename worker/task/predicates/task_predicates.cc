// SPDX-License-Identifier: Apache-2.0
#include "worker/task/predicates/task_predicates.h"

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

/// Calls `visit(key, predicate)` for each that the task has.
template <class Visit>
void ForEachPredicate(const TaskSpec& task, const Visit& visit) {
  visit("success", task.success);
  if (task.latched) visit("latched", *task.latched);
  if (task.start.not_already) visit("start.not_already", *task.start.not_already);
}

}  // namespace

Status CheckPredicates(const TaskSpec& task, const std::vector<std::string>& objects) {
  const std::string reference = task.reference.needed ? kReference : "";
  Status first;  // that is wrong
  ForEachPredicate(task, [&](const char* key, const PredicateSpec& spec) {
    if (!first) return;
    Cast cast{.target = kTarget, .reference = reference, .objects = {kTarget, kReference}};
    AddNamed(spec, objects, cast.objects);
    if (const auto made = MakePredicate(spec, cast); !made)
      first = Fail(made.error().code, fmt::format("task '{}': {}: {}", task.name, key, made.error().message));
  });
  return first;
}

std::vector<std::string> NamedObjects(const TaskSpec& task, const std::vector<std::string>& objects) {
  std::vector<std::string> names;
  ForEachPredicate(task, [&](const char*, const PredicateSpec& spec) { AddNamed(spec, objects, names); });
  return names;
}

std::vector<std::string> NamedObjects(const PredicateSpec& predicate, const std::vector<std::string>& objects) {
  std::vector<std::string> names;
  AddNamed(predicate, objects, names);
  return names;
}

}  // namespace etude::task
