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

std::vector<std::string> WithReference(const TaskSpec& task, std::vector<std::string> drawn,
                                       const std::vector<std::string>& objects) {
  if (!task.reference.needed || !PossibleTargets(task, drawn).empty()) return drawn;
  const auto fits = [&](const std::string& object) {
    return !PossibleReferences(task, drawn.front(), {object}).empty();
  };
  const auto it = std::ranges::find_if(objects, fits);
  if (it == objects.end()) return drawn;
  if (drawn.size() > 1) drawn.pop_back();
  drawn.push_back(*it);
  return drawn;
}

}  // namespace etude
