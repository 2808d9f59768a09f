// SPDX-License-Identifier: Apache-2.0
// Names of tasks, and the tasks that they name: a task alone or with something that the robot must not touch.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/spec/task_spec.h"

namespace etude {

/// The object that stands in the way in tasks "...+obstacle".
inline constexpr const char* kObstacleObject = "basketball";

/// "pick", "place_left", "push+obstacle", "my/task.yaml+others". Made by ParseTask.
struct TaskName {
  std::string base;   ///< name of a built-in task, or the path of a user's task file
  std::string avoid;  ///< "" | "obstacle" (kObstacleObject) | "others" (all but the target and what it ends on)
  std::shared_ptr<const TaskSpec> spec;

  /// Is about a second object too, the reference.
  bool relation() const { return spec && spec->reference.needed; }
  std::string text() const { return avoid.empty() ? base : base + "+" + avoid; }
};

/// True for a path to a user's task file, without "+obstacle": it ends in ".yaml".
bool IsTaskPath(const std::string& base);

/// The built-in tasks, by name: the files of FindShared("tasks"), read once. None when they cannot be read; ParseTask
/// says why. Thread safety: concurrent calls.
std::vector<std::string> BaseTasks();
/// Those and their variants with something to avoid.
std::vector<std::string> KnownTasks();
/// A user's file is read once by a process, up to ForgetTaskFiles: what it says then counts.
/// @error kInvalidArgument: unknown (the message has the nearest known one), or a file that makes no sense; kNotFound
/// Thread safety: concurrent calls.
Result<TaskName> ParseTask(const std::string& name);
/// From now on users' files say what they say when they are read next. For a process that takes up another campaign;
/// within one a task must not change its meaning. Thread safety: concurrent calls, also of the others here.
void ForgetTaskFiles();

}  // namespace etude
