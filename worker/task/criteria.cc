// SPDX-License-Identifier: Apache-2.0
#include "worker/task/criteria.h"

#include "services/core/check.h"

namespace etude::task {

std::string SideOf(const std::string& relation) {
  ETUDE_CHECK(relation.starts_with("place_"), "task={}", relation);
  return relation.substr(std::string("place_").size());
}

Criteria CriteriaOf(const TaskName& task) {
  ETUDE_CHECK(task.spec, "task={}", task.text());
  return {task.spec->success, task.spec->latched.value_or(task.spec->success)};
}

Eigen::Vector3d DirectionOf(const std::string& relation) { return DirectionOfSide(SideOf(relation)); }

bool IsBeside(const std::string& relation, const Eigen::Vector3d& p_WO, const Eigen::Vector3d& p_WR) {
  return IsOnSide(SideOf(relation), p_WO, p_WR);
}

}  // namespace etude::task
