// SPDX-License-Identifier: Apache-2.0
#include "worker/task/criteria.h"

#include <gmock/gmock.h>

#include <numbers>
#include <string>
#include <utility>

#include "services/episode/action.h"

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

TEST(SuccessCriterion, RotateNeedsTheTurnWhileItIsUp) {
  const Pose start = At(0, 0.3, 0.04, {0, 0, 0.3});
  const Eigen::Quaterniond turned = FromEuler({kHalfTurn, 0, 0}) * start.q;
  SuccessCriterion rotate("rotate", start);
  rotate.Observe({.X_WO = {{0, 0.3, 0.03}, turned}});  // fell over, never lifted
  EXPECT_FALSE(rotate.success());
  rotate.Observe({.X_WO = {{0, 0.3, kLiftedHeight + 0.01}, start.q}});
  rotate.Observe({.X_WO = {{0, 0.3, 0.15}, FromEuler({kHalfTurn - kTurnTolerance - 0.02, 0, 0}) * start.q}});
  EXPECT_FALSE(rotate.success()) << "not far enough";
  rotate.Observe({.X_WO = {{0, 0.3, kLaidHeight - 0.01}, turned}});
  EXPECT_FALSE(rotate.success()) << "turned only after it was dropped";
  rotate.Observe({.X_WO = {{0, 0.3, 0.12}, FromEuler({kHalfTurn - kTurnTolerance + 0.02, 0, 0}) * start.q}});
  EXPECT_TRUE(rotate.success());
  rotate.Observe({.X_WO = start});
  EXPECT_TRUE(rotate.success()) << "latched";
}

TEST(SuccessCriterion, RotateCountsEitherWayAboutXOnly) {
  const Pose start = At(0, 0.3, 0.04);
  for (const auto& [rpy, success] : {std::pair{Eigen::Vector3d(kHalfTurn, 0, 0), true},
                                     {Eigen::Vector3d(-kHalfTurn, 0, 0), true},
                                     {Eigen::Vector3d(0, kHalfTurn, 0), false},
                                     {Eigen::Vector3d(0, 0, kHalfTurn), false}}) {
    SuccessCriterion rotate("rotate", start);
    rotate.Observe({.X_WO = At(0, 0.3, 0.2)});
    rotate.Observe({.X_WO = At(0, 0.3, 0.2, rpy)});
    EXPECT_EQ(rotate.success(), success) << rpy.transpose();
  }
}

// The four relations: what one looks like from the reference, and where the target was before.
class Relation : public testing::TestWithParam<const char*> {
 protected:
  static Eigen::Vector3d p_WR() { return {0.1, 0.25, 0.04}; }
  static Pose From() { return At(-0.3, 0.2, 0.04); }
  static Pose Reference() { return {p_WR(), Eigen::Quaterniond::Identity()}; }
  Pose Beside(double along = kBeside, double aside = 0) const {
    const Eigen::Vector3d d = DirectionOf(GetParam());
    const Eigen::Vector3d across(-d.y(), d.x(), 0);
    return {p_WR() + along * d + aside * across, Eigen::Quaterniond::Identity()};
  }
  static void Lift(SuccessCriterion& criterion) {
    criterion.Observe({.X_WO = At(-0.3, 0.2, 0.04 + kPickRise + 0.01), .X_WR = Reference(), .held = true});
  }
  static void Stand(SuccessCriterion& criterion, const Pose& X_WO, bool held = false, int steps = kRestSteps + 1) {
    for (int t = 0; t < steps; ++t) criterion.Observe({.X_WO = X_WO, .X_WR = Reference(), .held = held});
  }
};

TEST_P(Relation, IsDoneWhenItStandsThereReleasedAfterItWasLifted) {
  SuccessCriterion place(GetParam(), From());
  Lift(place);
  Stand(place, Beside());
  EXPECT_TRUE(place.success());
  Stand(place, At(0, 0, 0.04));
  EXPECT_TRUE(place.success()) << "latched";
}

TEST_P(Relation, IsNotDoneByPushingItThere) {
  SuccessCriterion place(GetParam(), From());
  Stand(place, Beside());
  EXPECT_FALSE(place.success());
}

TEST_P(Relation, IsNotDoneWhileItIsHeld) {
  SuccessCriterion place(GetParam(), From());
  Lift(place);
  Stand(place, Beside(), true, 200);
  EXPECT_FALSE(place.success());
  Stand(place, Beside(), false, kRestSteps - 1);
  EXPECT_FALSE(place.success()) << "not long enough";
  Stand(place, Beside(), false, 1);
  EXPECT_TRUE(place.success());
}

TEST_P(Relation, IsNotDoneWhileItMoves) {
  SuccessCriterion place(GetParam(), From());
  Lift(place);
  const Eigen::Vector3d d = DirectionOf(GetParam());
  Pose X_WO = Beside(0.06);
  for (int t = 0; t < 100; ++t) {  // 0.1 m/s, all the way where it should be
    X_WO.p += d * (0.1 / kControlRate);
    ASSERT_TRUE(IsBeside(GetParam(), X_WO.p, p_WR()));
    place.Observe({.X_WO = X_WO, .X_WR = Reference()});
  }
  EXPECT_FALSE(place.success());
  Stand(place, X_WO);
  EXPECT_TRUE(place.success());
}

TEST_P(Relation, HasBoundsAlongAndAcrossAndOneSideOnly) {
  const auto beside = [&](double along, double aside) { return IsBeside(GetParam(), Beside(along, aside).p, p_WR()); };
  EXPECT_TRUE(beside(kBesideNear + 1e-3, 0));
  EXPECT_FALSE(beside(kBesideNear - 1e-3, 0));
  EXPECT_TRUE(beside(kBesideFar - 1e-3, 0));
  EXPECT_FALSE(beside(kBesideFar + 1e-3, 0));
  for (const double sign : {-1.0, 1.0}) {
    EXPECT_TRUE(beside(kBeside, sign * (kBesideAside - 1e-3)));
    EXPECT_FALSE(beside(kBeside, sign * (kBesideAside + 1e-3)));
  }
  EXPECT_FALSE(beside(-kBeside, 0));
  int relations = 0;
  for (const char* other : {"place_left", "place_right", "place_front", "place_behind"})
    relations += IsBeside(other, Beside().p, p_WR());
  EXPECT_EQ(relations, 1) << "one relation is never two";
}

TEST_P(Relation, FollowsTheReferenceWhenItWasMoved) {
  SuccessCriterion place(GetParam(), From());
  Lift(place);
  Pose moved = Reference();
  moved.p += Eigen::Vector3d(0.05, -0.04, 0);
  Pose X_WO = Beside();
  X_WO.p += Eigen::Vector3d(0.05, -0.04, 0);
  for (int t = 0; t < kRestSteps + 1; ++t) place.Observe({.X_WO = X_WO, .X_WR = moved});
  EXPECT_TRUE(place.success());
}

INSTANTIATE_TEST_SUITE_P(Four, Relation, testing::Values("place_left", "place_right", "place_front", "place_behind"),
                         [](const auto& info) { return std::string(info.param); });

TEST(Relations, AreAsSeenInThePicture) {
  // the camera looks from +y towards the robot: its left is +x
  const Eigen::Vector3d p_WR(0, 0.25, 0.04);
  EXPECT_TRUE(IsBeside("place_left", {0.12, 0.25, 0.04}, p_WR));
  EXPECT_TRUE(IsBeside("place_right", {-0.12, 0.25, 0.04}, p_WR));
  EXPECT_TRUE(IsBeside("place_front", {0, 0.37, 0.04}, p_WR));
  EXPECT_TRUE(IsBeside("place_behind", {0, 0.13, 0.04}, p_WR));
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
