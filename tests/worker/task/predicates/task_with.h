// SPDX-License-Identifier: Apache-2.0
// A task that is its predicates and nothing else.
#pragma once

#include <string>

#include "services/core/config.h"
#include "services/spec/task_spec.h"

namespace etude::task {

inline PredicateSpec Spec(const std::string& yaml) {
  return PredicateFromJson(ParseYaml(yaml, "test").value(), "test").value();
}

inline TaskSpec TaskWith(const std::string& success) {
  TaskSpec task;
  task.name = "mine";
  task.success = Spec(success);
  return task;
}

}  // namespace etude::task
