// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/stage_planner.cc
#include "worker/task/stage_planner.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/sketch_robot.h"
#include "tests/worker/sim/scene_fixture.h"

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

// ---- stages in a scene ----------------------------------------------------------------------------

// An arm at home in a scene with all objects, none of which is on the table until it is put there.
class StagePlannerTest : public testing::Test {
 protected:
  explicit StagePlannerTest(std::shared_ptr<const sim::Scene> scene = sim::FullScene()) : scene_(std::move(scene)) {
    X_WE_home_ = planner_.kinematics().X_WE(q_home_);
  }

  // Where a hand at home's height meets it, or as much higher.
  void Put(const std::string& name, const Eigen::Vector3d& over, double higher = 0) {
    for (const auto& object : scene_->objects()) {
      const Eigen::Vector3d p(over.x(), over.y(), object.rest_height + 0.002 + higher);
      if (object.name == name) checker_.SetObject(name, {p, Eigen::Quaterniond::Identity()});
    }
  }
  Pose ToTheSide(double dx, double dy, double dz) const {
    Pose goal = X_WE_home_;
    goal.p += Eigen::Vector3d(dx, dy, dz);
    return goal;
  }
  // A bottle on the straight way to the goal that it returns, which is so much further away.
  Pose Blocked(double dy = 0.1) {
    const Pose goal = ToTheSide(0.25, dy, 0);
    bottle_ = (X_WE_home_.p + goal.p) / 2;
    Put("bottle", bottle_);
    return goal;
  }
  PlannedStage Plan(const Pose& goal, const Stage& stage, const Surroundings& around = {}) {
    return planner_.Plan(q_home_, goal, stage, around, 1);
  }
  // Its motion begins at home, ends at the goal, and touches nothing on the way.
  void ExpectGood(const PlannedStage& planned, const Pose& goal) {
    ASSERT_TRUE(planned.planned()) << planned.outcome.reason;
    const plan::Motion& motion = planned.outcome.motion;
    EXPECT_LT((motion.X_WE.front().p - X_WE_home_.p).norm(), 1e-6);
    EXPECT_LT((motion.X_WE.back().p - goal.p).norm(), 1e-6);
    EXPECT_LT(AngleBetween(motion.X_WE.back().q, goal.q), 1e-5);
    EXPECT_EQ(motion.V_WE.back().norm(), 0);
    EXPECT_LT((planner_.kinematics().X_WE(planned.q_end).p - goal.p).norm(), 1e-3);
    const auto blockage = planner_.FindBlockage(motion, 0, q_home_);
    EXPECT_FALSE(blockage) << blockage->reason;
  }

  std::shared_ptr<const sim::Scene> scene_;
  collide::Checker checker_{scene_};
  StagePlanner planner_{scene_, &checker_};
  const Eigen::VectorXd& q_home_ = scene_->arm().q_home;
  Pose X_WE_home_;
  Eigen::Vector3d bottle_ = Eigen::Vector3d::Zero();
};

TEST_F(StagePlannerTest, GoesStraightWhereItIsFree) {
  const Pose goal = ToTheSide(0.2, 0.1, 0.1);
  const PlannedStage planned = Plan(goal, Stage{});
  ExpectGood(planned, goal);
  EXPECT_EQ(planned.way(), "line");
  EXPECT_EQ(planned.blocked, "");
}

TEST_F(StagePlannerTest, NearContactABlockedLineIsAFailureThatNamesWhatBlocks) {
  Stage stage;
  stage.straight_only = true;
  const PlannedStage planned = Plan(Blocked(), stage, {.hands = {bottle_}});
  EXPECT_FALSE(planned.planned());
  EXPECT_NE(planned.outcome.reason.find("bottle"), std::string::npos) << planned.outcome.reason;
}

TEST_F(StagePlannerTest, ALevelHandGoesBehindWhatIsInItsWay) {
  const Pose goal = Blocked(0.2);
  const PlannedStage planned = Plan(goal, Stage{}, {.hands = {bottle_}});
  ExpectGood(planned, goal);
  EXPECT_EQ(planned.way(), "detour");
  EXPECT_NE(planned.blocked.find("bottle"), std::string::npos) << planned.blocked;
  EXPECT_EQ(planned.outcome.samples, 0) << "straight pieces, the same for every seed";
  for (const Pose& X_WE : planned.outcome.motion.X_WE) {
    EXPECT_NEAR(X_WE.p.z(), X_WE_home_.p.z(), 1e-6) << "not over it";
    if (std::abs(X_WE.p.x() - bottle_.x()) < 0.05) {
      EXPECT_LT(X_WE.p.y(), bottle_.y() - 0.09);
    }
  }
}

TEST_F(StagePlannerTest, AHandFromAboveGoesOverWhatIsInItsWay) {
  const Pose goal = Blocked();
  Stage stage;
  stage.detours_over = true;
  const double over = X_WE_home_.p.z() + 0.28;
  const PlannedStage planned = Plan(goal, stage, {.over = over});
  ExpectGood(planned, goal);
  EXPECT_EQ(planned.way(), "detour");
  double highest = 0;
  for (const Pose& X_WE : planned.outcome.motion.X_WE) highest = std::max(highest, X_WE.p.z());
  EXPECT_NEAR(highest, over, 0.02) << "corners are rounded";
}

TEST_F(StagePlannerTest, WithoutAWayOfStraightPiecesOneIsSampled) {
  const Pose goal = Blocked(0);
  const PlannedStage planned = Plan(goal, Stage{});  // nobody says where the bottle is: the pieces lead into it
  ExpectGood(planned, goal);
  EXPECT_EQ(planned.way(), "rrt");
  EXPECT_NE(planned.blocked.find("bottle"), std::string::npos);
  EXPECT_GT(planned.outcome.samples, 0);
}

TEST_F(StagePlannerTest, WithAClearanceTheFieldPlansAndKeepsIt) {
  const Pose goal = Blocked();
  Stage stage;
  stage.clearance = 0.05;
  const PlannedStage planned = Plan(goal, stage, {.avoid = {"bottle"}});
  ExpectGood(planned, goal);
  EXPECT_TRUE(planned.way() == "field" || planned.way() == "field_escaped") << planned.way();
  EXPECT_EQ(planned.blocked, "") << "no line was tried";
}

TEST_F(StagePlannerTest, WhatCannotBeReachedIsNoPlan) {
  for (const double clearance : {0.0, 0.05}) {
    Stage stage;
    stage.clearance = clearance;
    const PlannedStage planned = Plan(ToTheSide(0, 3, 0), stage);
    EXPECT_FALSE(planned.planned());
    EXPECT_EQ(planned.outcome.kind, plan::OutcomeKind::kGoalUnreachable);
    EXPECT_DEATH((void)planned.way(), "goal_unreachable");
  }
}

TEST_F(StagePlannerTest, ACornerIsCutWhereThereIsRoom) {
  const Pose corner = ToTheSide(0.2, 0, 0.1), goal = ToTheSide(0.2, 0.12, 0.1);
  const plan::Limits limits;
  const plan::Motion a = plan::StraightMotion(X_WE_home_, corner, limits);
  const plan::Motion b = plan::StraightMotion(corner, goal, limits);
  const auto q_corner = planner_.Solve(corner, q_home_);
  ASSERT_TRUE(q_corner);

  plan::Motion joined = a;
  const int overlap = planner_.JoinIfFree(joined, b, limits, *q_corner);
  EXPECT_GT(overlap, 0);
  EXPECT_EQ(joined.steps(), a.steps() + b.steps() - overlap);
  const Pose cut = joined.X_WE[a.steps() - overlap + 2 * (overlap / 4)];  // one that is looked at

  // one joint that may hardly move makes every corner too fast
  plan::Limits slow = limits;
  slow.joint = 1e-3;
  joined = a;
  EXPECT_EQ(planner_.JoinIfFree(joined, b, slow, *q_corner), 0);
  EXPECT_EQ(joined.steps(), a.steps() + b.steps()) << "behind each other, with a stop";

  // something stands where the corner is cut
  const auto q_cut = planner_.Solve(cut, *q_corner);
  ASSERT_TRUE(q_cut);
  for (double dx = 0; dx < 0.1 && !checker_.Check(*q_cut); dx += 0.005)
    Put("bottle", cut.p + Eigen::Vector3d(dx, 0, 0), 0.1);
  ASSERT_TRUE(checker_.Check(*q_cut));
  joined = a;
  EXPECT_LT(planner_.JoinIfFree(joined, b, limits, *q_corner), overlap) << "less of it, or none";
}

// Five joints come to every place with the hand pointing down, and to few places otherwise.
class FiveJoints : public StagePlannerTest {
 protected:
  FiveJoints() : StagePlannerTest(TheScene()) {}
  static std::shared_ptr<const sim::Scene> TheScene() {
    static std::shared_ptr<const sim::Scene> scene;
    if (scene) return scene;
    SketchRobot sketch;
    sketch.WithoutRoll();
    SceneSpec spec;
    spec.robot = sketch.yaml();
    return scene = sim::Scene::Build(spec).value();
  }
};

TEST_F(FiveJoints, GoOverWhatIsInTheirWayWithTheHandPointingDown) {
  ASSERT_EQ(q_home_.size(), 5);
  ASSERT_FALSE(scene_->arm().turns_any_way());
  Stage stage;
  stage.detours_over = true;
  stage.limits.joint = 2.0;
  // low enough for the bottle to be in the way
  const Pose low = ToTheSide(-0.12, 0, 0.06 - X_WE_home_.p.z()), goal = ToTheSide(0.12, 0, 0.06 - X_WE_home_.p.z());
  const auto q_low = planner_.Solve(low, q_home_);
  ASSERT_TRUE(q_low);
  Put("bottle", (low.p + goal.p) / 2);
  ASSERT_FALSE(checker_.Check(*q_low)) << "it begins beside it";
  const double over = X_WE_home_.p.z() + 0.2;

  const PlannedStage planned = planner_.Plan(*q_low, goal, stage, {.over = over}, 1);

  ASSERT_TRUE(planned.planned()) << planned.outcome.reason;
  EXPECT_EQ(planned.way(), "detour");
  EXPECT_NE(planned.blocked.find("bottle"), std::string::npos) << planned.blocked;
  EXPECT_FALSE(planner_.FindBlockage(planned.outcome.motion, 0, *q_low));
  Eigen::VectorXd q = *q_low;
  for (const Pose& X_WE : planned.outcome.motion.X_WE) {
    EXPECT_LT(AngleBetween(X_WE.q, low.q), 0.05) << "five joints cannot turn it and come to any place";
    const auto next = planner_.Solve(X_WE, q);
    ASSERT_TRUE(next) << "an arm of five joints is lost there";
    EXPECT_LE((*next - q).cwiseAbs().maxCoeff() * kControlRate, 2.0 * 1.1);
    q = *next;
  }
}

TEST_F(FiveJoints, AHandThatWouldHaveToTiltAsideIsNoPlan) {
  Pose tilted = ToTheSide(0.15, 0, 0);
  tilted.q = (Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitY()) * tilted.q).normalized();
  const PlannedStage planned = Plan(tilted, Stage{});
  EXPECT_FALSE(planned.planned());
  EXPECT_EQ(planned.outcome.kind, plan::OutcomeKind::kGoalUnreachable) << planned.outcome.reason;
}

}  // namespace stage_planner_test
}  // namespace etude::task
