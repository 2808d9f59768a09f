// SPDX-License-Identifier: Apache-2.0
// The gripper takes every object, lifts it, turns it over and swings it about without losing it.
#include <cmath>
#include <numbers>

#include "tests/worker/sim/scene_fixture.h"

namespace etude::sim {
namespace {

constexpr double kPi = std::numbers::pi;
const auto kIgnore = [](const Pose&) {};

class Grasp : public testing::TestWithParam<std::string> {};

TEST_P(Grasp, HoldsThroughLiftTurnAndSwing) {
  const std::string object = GetParam();
  World world(FullScene());
  Kinematics kinematics(FullScene());
  const Pose X_WO = world.ObjectPose(object);
  const Eigen::Quaterniond level = FromEuler({kPi, 0, kPi / 2}), down = FromEuler({kPi / 2, 0, kPi / 2});
  const auto ready = kinematics.Solve({X_WO.p + Eigen::Vector3d(0, -0.15, 0.01), level}, FullScene()->arm().q_home);
  ASSERT_TRUE(ready);
  world.SetArm(*ready);
  world.Forward();
  // 3 mm off the middle: the fingers centre the object
  const Pose at{X_WO.p + Eigen::Vector3d(0.003, 0.02, 0.01), level};
  MoveTo(world, at, 0.3, 0, 10, kIgnore);
  EXPECT_LT((world.ObjectPose(object).p - X_WO.p).norm(), 1e-3) << "the approach must not touch it";

  double before = 0;
  for (int i = 0; i < 35; ++i) {
    if (i == 34) before = world.gripper_q()[0];
    world.Step({at, 1}, Vector6d::Zero());
  }
  EXPECT_NEAR(world.gripper_q()[0], before, 1e-3) << "settled";
  ASSERT_TRUE(world.Grasped(object)) << "fingers at " << world.gripper_q()[0];
  const Pose X_EO = world.X_WE().inverse() * world.ObjectPose(object);

  const Pose up{{at.p.x(), at.p.y(), 0.25}, level};
  MoveTo(world, up, 0.3, 1, 10, kIgnore);
  const Pose turned{{at.p.x(), at.p.y() - 0.15, 0.25}, down};
  MoveTo(world, turned, 0.4, 1, 60, kIgnore);
  MoveTo(world, {turned.p + Eigen::Vector3d(0.15, 0, 0), down}, 0.5, 1, 0, kIgnore);
  MoveTo(world, {turned.p - Eigen::Vector3d(0.05, 0, 0), down}, 0.5, 1, 60, kIgnore);

  ASSERT_TRUE(world.Grasped(object));
  const Pose X_EO_end = world.X_WE().inverse() * world.ObjectPose(object);
  EXPECT_LT((X_EO_end.p - X_EO.p).norm(), 4e-3);
  EXPECT_LT(AngleBetween(X_EO_end.q, X_EO.q), 5 * kPi / 180);
  EXPECT_TRUE(world.healthy());
  RecordProperty("slip_mm", std::to_string((X_EO_end.p - X_EO.p).norm() * 1e3));
  RecordProperty("finger_rad", std::to_string(before));

  // let go just above the table, on its side: it stays where it falls
  MoveTo(world, {{0, 0.13, 0.20}, down}, 0.3, 1, 10, kIgnore);
  MoveTo(world, {{0, 0.13, 0.03}, down}, 0.3, 1, 10, kIgnore);
  const Pose held = world.ObjectPose(object);
  MoveTo(world, {{0, 0.13, 0.03}, down}, 0.3, 0, 15, kIgnore);
  MoveTo(world, {{0, 0.13, 0.20}, down}, 0.3, 0, 60, kIgnore);
  EXPECT_FALSE(world.Grasped(object));
  const Pose fallen = world.ObjectPose(object);
  EXPECT_LT((fallen.p - held.p).head<2>().norm(), 0.03);
  EXPECT_GT(std::acos((fallen.q * Eigen::Vector3d::UnitZ()).z()), 75 * kPi / 180) << "lies on its side";
  MoveTo(world, {{0, 0.13, 0.20}, down}, 0.3, 0, 60, kIgnore);
  EXPECT_LT((world.ObjectPose(object).p - fallen.p).norm(), 1e-3) << "at rest";
  EXPECT_TRUE(world.healthy());
}

INSTANTIATE_TEST_SUITE_P(EveryObject, Grasp, testing::Values("cube", "coke", "pepsi", "milk", "bread", "bottle"),
                         [](const auto& info) { return info.param; });

}  // namespace
}  // namespace etude::sim
