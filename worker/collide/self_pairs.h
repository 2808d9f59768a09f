// SPDX-License-Identifier: Apache-2.0
// How the arm's bodies move against each other, found from its kinematics alone. Internal to
// worker/collide.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "worker/sim/world.h"

namespace etude::collide::internal {

/// Facts about the bodies of ArmInfo, by index; `world` is a further body with index bodies.size().
struct ArmStructure {
  /// (n + 1, n + 1) number of arm joints that change the pose of one body in the other; gripper
  /// joints do not count.
  Eigen::MatrixXi joints_between;
  /// Bodies that stand still against the tool while only arm joints move: the gripper and the last
  /// link.
  std::vector<bool> with_tool;
  int tool_body = 0;  ///< a body rigid with the tool, the gripper's opening included
  Pose X_BE;          ///< tool in that body
};

ArmStructure FindStructure(const sim::ArmInfo& arm, sim::Kinematics& kinematics);

/// Configurations that are spread over the joint limits, the same at each call.
std::vector<Eigen::VectorXd> SpreadConfigurations(const sim::ArmInfo& arm, int count);

}  // namespace etude::collide::internal
