// SPDX-License-Identifier: Apache-2.0
#include "services/spec/task_roles.h"

#include <algorithm>
#include <iterator>

#include "services/spec/object_names.h"

namespace etude {

std::vector<std::string> PossibleReferences(const TaskSpec& task, const std::string& target,
                                            const std::vector<std::string>& objects) {
  std::vector<std::string> references;
  std::ranges::copy_if(objects, std::back_inserter(references), [&](const auto& object) {
    return SceneName(object) != SceneName(target) && task.MayRefer(target, object);
  });
  return references;
}

std::vector<std::string> PossibleTargets(const TaskSpec& task, const std::vector<std::string>& objects) {
  if (!task.reference.needed) return objects;
  std::vector<std::string> targets;
  std::ranges::copy_if(objects, std::back_inserter(targets),
                       [&](const auto& object) { return !PossibleReferences(task, object, objects).empty(); });
  return targets;
}

namespace {

// In place of another instance of its class, else of the last one that is not the target.
std::vector<std::string> PutBeside(std::vector<std::string> drawn, const std::string& target,
                                   const std::string& reference) {
  const auto same_class = [&](const auto& object) { return ObjectNoun(object) == ObjectNoun(reference); };
  if (const auto it = std::ranges::find_if(drawn, same_class); it != drawn.end()) {
    *it = reference;
    return drawn;
  }
  if (drawn.size() > 1) drawn.erase(std::prev(drawn.end(), drawn.back() == target ? 2 : 1));
  drawn.push_back(reference);
  return drawn;
}

}  // namespace

std::vector<std::string> WithReference(const TaskSpec& task, std::vector<std::string> drawn,
                                       const std::vector<std::string>& objects) {
  if (!task.reference.needed || !PossibleTargets(task, drawn).empty()) return drawn;
  const std::vector<std::string> targets = drawn;
  for (const std::string& target : targets) {
    const auto it = std::ranges::find_if(
        objects, [&](const auto& object) { return !PossibleReferences(task, target, {object}).empty(); });
    if (it != objects.end()) return PutBeside(std::move(drawn), target, *it);
  }
  return drawn;
}

namespace {

// On or in it: beside it, it is something not to touch like any other.
bool RestsOnReference(const TaskSpec& task) {
  return std::ranges::any_of(task.stages, [](const StageSpec& stage) {
    const auto* place = std::get_if<PlaceSpec>(&stage);
    return place && (place->whereto() == Whereto::kOnTop || place->whereto() == Whereto::kInside);
  });
}

}  // namespace

std::vector<std::string> AvoidedObjects(const TaskName& task, const std::string& target, const std::string& reference,
                                        const std::vector<std::string>& objects) {
  if (task.avoid == "obstacle") return {kObstacleObject};
  if (task.avoid != "others") return {};
  std::vector<std::string> others = SceneNames(objects);
  std::erase(others, target);
  if (RestsOnReference(*task.spec)) std::erase(others, reference);
  return others;
}

}  // namespace etude
