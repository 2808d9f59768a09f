// SPDX-License-Identifier: Apache-2.0
#include "worker/task/primitives/stage.h"

#include <utility>

#include "services/core/check.h"

namespace etude::task {

Stage HeldStage(std::string_view name, Goal goal, const plan::Limits& limits) {
  return {.name = std::string(name),
          .goal = std::move(goal),
          .closed = true,
          .limits = limits,
          .touches_target = true,
          .holds = true,
          .disturbable = true,
          .calm = 0.04};
}

double HeldBelow(const StageContext& now, const Eigen::Quaterniond& q_WE) {
  ETUDE_CHECK(now.X_EO.has_value());
  const Pose X_WO = Pose{Eigen::Vector3d::Zero(), q_WE} * *now.X_EO;  // for a hand at the origin
  return now.shapes->HeightOnTable(now.target, X_WO.q) - X_WO.p.z();
}

}  // namespace etude::task
