// SPDX-License-Identifier: Apache-2.0
// Private to services/spec: what a task's file must say to make sense.
#pragma once

#include <string>
#include <vector>

#include "services/spec/task_spec.h"

namespace etude {

/// here, left, right, front, behind, on_top, inside
const std::vector<std::string>& WheretoNames();

/// Everything that is wrong with a task whose keys could be read; empty when it makes sense.
std::vector<std::string> ProblemsOf(const TaskSpec& task);

}  // namespace etude
