// SPDX-License-Identifier: Apache-2.0
// The gripper takes every object, lifts it, turns it over and swings it about without losing it.
#include <cmath>
#include <numbers>

#include "tests/worker/sim/scene_fixture.h"

namespace etude::sim {
namespace grasp_test {

using std::numbers::pi;
const auto kIgnore = [](const Pose&) {};

const Eigen::Quaterniond kLevel = FromEuler({pi, 0, pi / 2}), kDown = FromEuler({pi / 2, 0, pi / 2});

class Grasp : public testing::TestWithParam<std::string> {
 protected:
  // Fingers around the object, 3 mm off the middle: they centre it. Where the hand is then.
  Pose Approach() {
    const Pose X_WO = Object();
    Kinematics kinematics(FullScene());
    const auto ready = kinematics.Solve({X_WO.p + Eigen::Vector3d(0, -0.15, 0.01), kLevel}, FullScene()->arm().q_home);
    EXPECT_TRUE(ready);
    world_.SetArm(ready.value());
    world_.Forward();
    const Pose at{X_WO.p + Eigen::Vector3d(0.003, 0.02, 0.01), kLevel};
    MoveTo(world_, at, 0.3, 0, 10, kIgnore);
    EXPECT_LT((Object().p - X_WO.p).norm(), 1e-3) << "the approach must not touch it";
    return at;
  }

  void Close(const Pose& at) {
    double before = 0;
    for (int i = 0; i < 35; ++i) {
      if (i == 34) before = world_.gripper_q()[0];
      world_.Step({at, 1}, Vector6d::Zero());
    }
    EXPECT_NEAR(world_.gripper_q()[0], before, 1e-3) << "settled";
    RecordProperty("finger_rad", std::to_string(before));
  }

  void LiftTurnAndSwing(const Pose& at) {
    MoveTo(world_, {{at.p.x(), at.p.y(), 0.25}, kLevel}, 0.3, 1, 10, kIgnore);
    const Pose turned{{at.p.x(), at.p.y() - 0.15, 0.25}, kDown};
    MoveTo(world_, turned, 0.4, 1, 60, kIgnore);
    MoveTo(world_, {turned.p + Eigen::Vector3d(0.15, 0, 0), kDown}, 0.5, 1, 0, kIgnore);
    MoveTo(world_, {turned.p - Eigen::Vector3d(0.05, 0, 0), kDown}, 0.5, 1, 60, kIgnore);
  }

  // Just above the table, on its side.
  void LetGo() {
    MoveTo(world_, {{0, 0.13, 0.20}, kDown}, 0.3, 1, 10, kIgnore);
    MoveTo(world_, {{0, 0.13, 0.03}, kDown}, 0.3, 1, 10, kIgnore);
    const Pose held = Object();
    MoveTo(world_, {{0, 0.13, 0.03}, kDown}, 0.3, 0, 15, kIgnore);
    MoveTo(world_, {{0, 0.13, 0.20}, kDown}, 0.3, 0, 60, kIgnore);
    EXPECT_FALSE(world_.Grasped(GetParam()));
    EXPECT_LT((Object().p - held.p).head<2>().norm(), 0.03);
  }

  Pose Object() const { return world_.ObjectPose(GetParam()); }
  Pose InHand() const { return world_.X_WE().inverse() * Object(); }

  World world_{FullScene()};
};

TEST_P(Grasp, HoldsThroughLiftTurnAndSwing) {
  const Pose at = Approach();
  Close(at);
  ASSERT_TRUE(world_.Grasped(GetParam())) << "fingers at " << world_.gripper_q()[0];
  const Pose X_EO = InHand();

  LiftTurnAndSwing(at);
  ASSERT_TRUE(world_.Grasped(GetParam()));
  const Pose X_EO_end = InHand();
  EXPECT_LT((X_EO_end.p - X_EO.p).norm(), 4e-3);
  EXPECT_LT(AngleBetween(X_EO_end.q, X_EO.q), 5 * pi / 180);
  EXPECT_TRUE(world_.healthy());
  RecordProperty("slip_mm", std::to_string((X_EO_end.p - X_EO.p).norm() * 1e3));

  // it stays where it falls
  LetGo();
  const Pose fallen = Object();
  EXPECT_GT(std::acos((fallen.q * Eigen::Vector3d::UnitZ()).z()), 75 * pi / 180) << "lies on its side";
  MoveTo(world_, {{0, 0.13, 0.20}, kDown}, 0.3, 0, 60, kIgnore);
  EXPECT_LT((Object().p - fallen.p).norm(), 1e-3) << "at rest";
  EXPECT_TRUE(world_.healthy());
}

INSTANTIATE_TEST_SUITE_P(EveryObject, Grasp, testing::Values("cube", "coke", "pepsi", "milk", "bread", "bottle"),
                         [](const auto& info) { return info.param; });

}  // namespace grasp_test
}  // namespace etude::sim
