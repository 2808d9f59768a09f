// SPDX-License-Identifier: Apache-2.0
// Which objects may play which part in a task. Objects as a campaign names them: names or paths.
#pragma once

#include <string>
#include <vector>

#include "services/spec/task_name.h"
#include "services/spec/task_spec.h"

namespace etude {

/// Those of `objects` that the target may be put beside, on or into; none for a task without a reference.
std::vector<std::string> PossibleReferences(const TaskSpec& task, const std::string& target,
                                            const std::vector<std::string>& objects);
/// Those of `objects` that may be the target: with a reference, those that have a possible one.
std::vector<std::string> PossibleTargets(const TaskSpec& task, const std::vector<std::string>& objects);

/// `drawn` with one object replaced by one of `objects` that may be the reference, where none of `drawn` may: another
/// instance of its class, else the last.
std::vector<std::string> WithReference(const TaskSpec& task, std::vector<std::string> drawn,
                                       const std::vector<std::string>& objects);

/// What a task forbids to touch, of the objects of its scene (as SceneSpec names them); as scenes call them. Never the
/// target, nor a reference that it ends on or in.
std::vector<std::string> AvoidedObjects(const TaskName& task, const std::string& target, const std::string& reference,
                                        const std::vector<std::string>& objects);

}  // namespace etude
