// SPDX-License-Identifier: Apache-2.0
#include "worker/task/criteria.h"

#include "services/core/check.h"

namespace etude::task {

Criteria CriteriaOf(const TaskName& task) {
  ETUDE_CHECK(task.spec, "task={}", task.text());
  return {task.spec->success, task.spec->latched.value_or(task.spec->success)};
}

}  // namespace etude::task
