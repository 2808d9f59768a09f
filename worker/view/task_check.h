// SPDX-License-Identifier: Apache-2.0
// What a task's file means, on which robots it works, and what is wrong with it.
#pragma once

#include <string>
#include <vector>

#include "services/core/result.h"
#include "worker/sim/renderer.h"

namespace etude {

struct TaskCheckOptions {
  std::vector<std::string> robots{"ur5", "panda", "jaco2"};  ///< names or robot files
  int attempts = 3;                                          ///< demonstrations with each, >= 1
  bool as_json = false;                                      ///< one object at the end instead of lines
};

/// Prints the task in words (sentences, stages, when it is done) and how many attempts succeed with each robot, with
/// the reasons of those that fail.
/// As JSON {task, summary, sentences, reference, avoid, stages, success, latched, robots: [{robot, attempts, succeeded,
/// works, reasons}]}; nothing of a file that is refused.
/// @param task  path of a task file, or the name of a built-in task; "+obstacle" and "+others" may follow
/// @error kNotFound; kInvalidArgument: everything that is wrong with the file, or no robot for which most attempts
/// succeed
Status CheckTaskFile(const std::string& task, const TaskCheckOptions& options, const sim::RendererConfig& renderer);

}  // namespace etude
