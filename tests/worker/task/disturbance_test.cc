// SPDX-License-Identifier: Apache-2.0
#include "worker/task/disturbance.h"

#include <gtest/gtest.h>

namespace etude::task {
namespace disturbance_test {

TEST(DrawPush, StaysWithinTheSpec) {
  RandomizationSpec randomization;
  randomization.disturbance = 0.03;
  Rng rng(5);
  double longest = 0;
  for (int i = 0; i < 2000; ++i) {
    const Push push = DrawPush(randomization, rng);
    EXPECT_LE(push.offset.norm(), 0.03);
    EXPECT_GE(push.steps, 20);
    EXPECT_LE(push.steps, 30);
    longest = std::max(longest, push.offset.norm());
  }
  EXPECT_GT(longest, 0.027);
}

TEST(PushMotion, LeavesThePathSmoothlyAndEndsAtRestBesideIt) {
  const auto path = plan::StraightMotion({}, {{0.4, 0, 0}, Eigen::Quaterniond::Identity()}, {});
  const Push push{{0, 0.03, 0}, {0, 0, 0.1}, 25};
  const int from = path.steps() / 2;
  const auto pushed = PushMotion(path, from, push);
  ASSERT_EQ(pushed.steps(), 25);
  Eigen::Vector3d last = path.X_WE[from].p;
  Eigen::Vector3d last_velocity = path.V_WE[from].head<3>();
  for (int i = 0; i < pushed.steps(); ++i) {
    const Eigen::Vector3d velocity = (pushed.X_WE[i].p - last) * kControlRate;
    EXPECT_LT((velocity - last_velocity).norm(), 0.06) << i;
    EXPECT_LT((velocity - pushed.V_WE[i].head<3>()).norm(), 0.06) << i;
    last = pushed.X_WE[i].p;
    last_velocity = velocity;
  }
  EXPECT_NEAR(pushed.X_WE.back().p.y(), 0.03, 1e-9);
  EXPECT_NEAR(AngleBetween(pushed.X_WE.back().q, path.X_WE[from].q), 0.1, 1e-6);
  EXPECT_LT(pushed.V_WE.back().norm(), 0.02);
}

TEST(PushMotion, MayBeginNearTheEnd) {
  const auto path = plan::StraightMotion({}, {{0.1, 0, 0}, Eigen::Quaterniond::Identity()}, {});
  const auto pushed = PushMotion(path, path.steps() - 1, {{0, 0, 0.02}, {0, 0, 0}, 20});
  EXPECT_NEAR(pushed.X_WE.back().p.z(), 0.02, 1e-9);
  EXPECT_NEAR(pushed.X_WE.back().p.x(), 0.1, 1e-3);
}

}  // namespace disturbance_test
}  // namespace etude::task
