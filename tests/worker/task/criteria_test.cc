// SPDX-License-Identifier: Apache-2.0
#include "worker/task/criteria.h"

#include <gmock/gmock.h>

#include <numbers>

namespace etude::task {
namespace {

constexpr double kHalfTurn = std::numbers::pi / 2;

Pose At(double x, double y, double z, const Eigen::Vector3d& rpy = Eigen::Vector3d::Zero()) {
  return {{x, y, z}, FromEuler(rpy)};
}

TEST(SuccessCriterion, PickNeedsMoreThanThreeCentimetres) {
  SuccessCriterion pick("pick", At(0, 0.3, 0.04));
  pick.Observe({.X_WO = At(0, 0.4, 0.0699)});
  EXPECT_FALSE(pick.success());
  pick.Observe({.X_WO = At(0, 0.4, 0.0701)});
  EXPECT_TRUE(pick.success());
}

TEST(SuccessCriterion, PickStaysLatchedWhenTheObjectFalls) {
  SuccessCriterion pick("pick", At(0, 0.3, 0.04));
  pick.Observe({.X_WO = At(0, 0.3, 0.10)});
  pick.Observe({.X_WO = At(0, 0.3, 0.04)});
  EXPECT_TRUE(pick.success());
  EXPECT_NEAR(pick.progress(), 0.06, 1e-12);
}

TEST(SuccessCriterion, PushCountsOnlyAwayFromTheRobot) {
  SuccessCriterion push("push", At(0.1, 0.3, 0.04));
  push.Observe({.X_WO = At(0.3, 0.2, 0.04)});
  EXPECT_FALSE(push.success());
  push.Observe({.X_WO = At(0.1, 0.331, 0.04)});
  EXPECT_TRUE(push.success());
}

TEST(SuccessCriterion, PutDownIgnoresTurnAndHeightBeforeItWasLifted) {
  SuccessCriterion put("put_down", At(0, 0.3, 0.04));
  put.Observe({.X_WO = At(0, 0.3, 0.03, {-kHalfTurn, 0, 0})});  // fell over: turned and low, never lifted
  EXPECT_FALSE(put.success());
  put.Observe({.X_WO = At(0, 0.3, 0.15)});
  put.Observe({.X_WO = At(0, 0.3, 0.04)});  // down again, upright
  EXPECT_TRUE(put.lifted());
  EXPECT_TRUE(put.laid());
  EXPECT_FALSE(put.success());
}

TEST(SuccessCriterion, PutDownTurnsRelativeToTheStartYaw) {
  for (double yaw : {-0.3, 0.0, 0.3, 1.2}) {
    const Pose start = At(0, 0.3, 0.04, {0, 0, yaw});
    SuccessCriterion put("put_down", start);
    const Eigen::Quaterniond turned = FromEuler({-kHalfTurn, 0, 0}) * start.q;
    put.Observe({.X_WO = {{0, 0.3, 0.2}, start.q}});
    put.Observe({.X_WO = {{0, 0.2, 0.2}, turned}});
    EXPECT_FALSE(put.success()) << yaw;
    put.Observe({.X_WO = {{0, 0.2, 0.03}, turned}});
    EXPECT_TRUE(put.success()) << yaw;
  }
}

TEST(SuccessCriterion, PutDownRefusesTheWrongTurn) {
  const Pose start = At(0, 0.3, 0.04);
  for (const Eigen::Vector3d& wrong :
       {Eigen::Vector3d(0, kHalfTurn, 0), Eigen::Vector3d(-kHalfTurn, 0.4, 0.4), Eigen::Vector3d(0, -kHalfTurn, 0)}) {
    SuccessCriterion put("put_down", start);
    put.Observe({.X_WO = At(0, 0.3, 0.2)});
    put.Observe({.X_WO = At(0, 0.3, 0.03, wrong)});
    EXPECT_FALSE(put.success()) << wrong.transpose();
  }
}

TEST(LiesDown, TellsUprightFromLying) {
  EXPECT_FALSE(LiesDown(At(0, 0, 0.04)));
  EXPECT_TRUE(LiesDown(At(0, 0, 0.025, {-kHalfTurn, 0, 0})));
  EXPECT_TRUE(LiesDown(At(0, 0, 0.025, {0, kHalfTurn, 0})));
  EXPECT_FALSE(LiesDown(At(0, 0, 0.2, {-kHalfTurn, 0, 0}))) << "in the air";
}

TEST(DisturbanceWatch, NamesWhatMovedFarEnough) {
  DisturbanceWatch watch({{"coke", At(0, 0.3, 0.04)}, {"bread", At(0.2, 0.3, 0.04)}});
  watch.Observe("coke", At(0.019, 0.3, 0.04));
  watch.Observe("bread", At(0.2, 0.33, 0.04));
  watch.Observe("bread", At(0.2, 0.3, 0.04));  // back: it was moved all the same
  watch.Observe("milk", At(5, 5, 5));          // not watched
  EXPECT_THAT(watch.disturbed(), testing::ElementsAre("bread"));
}

}  // namespace
}  // namespace etude::task
