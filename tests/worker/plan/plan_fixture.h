// SPDX-License-Identifier: Apache-2.0
// An arm at home among objects, and a planner for it.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "tests/worker/sim/scene_fixture.h"
#include "worker/plan/planner.h"

namespace etude::plan {

class PlanFixture : public testing::Test {
 protected:
  PlanFixture() { X_WE_home_ = kinematics_.X_WE(q_home_); }

  /// From home (the hand level, near the table, 13 cm in front) to a place beside it.
  Request ToTheSide(double dx, double dy, double dz) const {
    Request request;
    request.q_start = q_home_;
    request.X_WE_goal = X_WE_home_;
    request.X_WE_goal.p += Eigen::Vector3d(dx, dy, dz);
    return request;
  }

  /// Joint positions along a motion by inverse kinematics from sample to sample, the start before them.
  std::vector<Eigen::VectorXd> JointsAlong(const Motion& motion, const Eigen::VectorXd& q_start) {
    std::vector<Eigen::VectorXd> joints{q_start};
    for (const Pose& X_WE : motion.X_WE) {
      const auto q = kinematics_.Solve(X_WE, joints.back());
      EXPECT_TRUE(q);
      if (!q) break;
      joints.push_back(*q);
    }
    return joints;
  }

  std::shared_ptr<const sim::Scene> scene_ = sim::FullScene();
  const Eigen::VectorXd& q_home_ = scene_->arm().q_home;
  sim::Kinematics kinematics_{scene_};
  collide::Checker checker_{scene_};
  Planner planner_{scene_};
  Pose X_WE_home_;
};

}  // namespace etude::plan
