// SPDX-License-Identifier: Apache-2.0
#include "worker/task/stage_planner.h"

#include <gtest/gtest.h>

namespace etude::task {
namespace stage_planner_test {

plan::Motion Straight(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double yaw_to = 0) {
  return plan::StraightMotion({from, Eigen::Quaterniond::Identity()}, {to, FromEuler({0, 0, yaw_to})}, {});
}

TEST(Join, EndsAtTheGoalOfTheSecond) {
  const auto a = Straight({0, 0, 0}, {0.3, 0, 0}, 0.4);
  auto b = plan::StraightMotion(a.X_WE.back(), {{0.3, 0.2, 0.1}, FromEuler({0, 0, 1.0})}, {});
  const auto joined = Join(a, b, 20);
  EXPECT_EQ(joined.steps(), a.steps() + b.steps() - 20);
  EXPECT_EQ(joined.X_WE.size(), joined.V_WE.size());
  EXPECT_LT((joined.X_WE.back().p - b.X_WE.back().p).norm(), 1e-9);
  EXPECT_LT(AngleBetween(joined.X_WE.back().q, b.X_WE.back().q), 1e-6);
}

TEST(Join, IsSmoothAndDoesNotStop) {
  const auto a = Straight({0, 0, 0}, {0.3, 0, 0});
  const auto b = Straight({0.3, 0, 0}, {0.6, 0, 0});
  const auto joined = Join(a, b, 25);
  double slowest = 1;
  for (int i = 1; i < joined.steps(); ++i) {
    const double moved = (joined.X_WE[i].p - joined.X_WE[i - 1].p).norm() * kControlRate;
    EXPECT_LT(moved, 0.45) << i;
    if (i > 40 && i < joined.steps() - 40) slowest = std::min(slowest, moved);
  }
  EXPECT_GT(slowest, 0.1);
}

TEST(Join, WithoutOverlapPutsThemInARow) {
  const auto a = Straight({0, 0, 0}, {0.1, 0, 0});
  const auto b = Straight({0.1, 0, 0}, {0.1, 0.1, 0});
  EXPECT_EQ(Join(a, b, 0).steps(), a.steps() + b.steps());
}

TEST(Join, OverlapIsBoundedByTheShorterMotion) {
  const auto a = Straight({0, 0, 0}, {0.001, 0, 0});
  const auto b = Straight({0.001, 0, 0}, {0.3, 0, 0});
  const auto joined = Join(a, b, 1000);
  EXPECT_LT((joined.X_WE.back().p - b.X_WE.back().p).norm(), 2e-3);
}

}  // namespace stage_planner_test
}  // namespace etude::task
