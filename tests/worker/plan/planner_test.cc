// SPDX-License-Identifier: Apache-2.0
// Tests worker/plan/planner.cc, planner_line.cc and planner_detour.cc, worker/plan/retime.cc and
// worker/plan/sampling.cc
#include "worker/plan/planner.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "services/core/rng.h"
#include "tests/worker/plan/motion_bits.h"
#include "tests/worker/plan/plan_fixture.h"

namespace etude::plan {
namespace planner_test {

constexpr double kPeriod = 1 / kControlRate;

Pose Standing(const std::string& name, const Eigen::Vector3d& at) {
  const auto& objects = sim::FullScene()->objects();
  const auto object = std::ranges::find_if(objects, [&](const auto& candidate) { return candidate.name == name; });
  Pose X_WO;
  X_WO.p = {at.x(), at.y(), object->rest_height + 0.002};
  return X_WO;
}

class PlannerTest : public PlanFixture {
 protected:
  // A bottle on the way that ToTheSide(0.25, 0.1, 0) takes.
  Request Blocked() {
    const Request request = ToTheSide(0.25, 0.1, 0);
    checker_.SetObject("bottle", Standing("bottle", (X_WE_home_.p + request.X_WE_goal.p) / 2));
    return request;
  }

  void ExpectWithinLimits(const Motion& motion, const Limits& limits) {
    for (int k = 0; k < motion.steps(); ++k) {
      EXPECT_LE(motion.V_WE[k].head<3>().norm(), limits.linear * 1.01) << k;
      EXPECT_LE(motion.V_WE[k].tail<3>().norm(), limits.angular * 1.01) << k;
      if (k == 0) continue;
      const Eigen::Matrix<double, 6, 1> change = (motion.V_WE[k] - motion.V_WE[k - 1]) / kPeriod;
      EXPECT_LE(change.head<3>().norm(), limits.linear_accel * 1.1) << k;
      EXPECT_LE(change.tail<3>().norm(), limits.angular_accel * 1.1) << k;
    }
  }
};

TEST_F(PlannerTest, GoesStraightWhereItIsFree) {
  const Request request = ToTheSide(0.2, 0.1, 0.1);
  const Outcome outcome = planner_.Plan(request, checker_, 1);

  ASSERT_EQ(outcome.kind, OutcomeKind::kStraight) << outcome.reason;
  EXPECT_EQ(outcome.samples, 0);
  EXPECT_GT(outcome.checks, 10u);
  EXPECT_EQ(outcome.motion.X_WE.back().p, request.X_WE_goal.p);
  const Motion line = StraightMotion(X_WE_home_, request.X_WE_goal, request.limits);
  EXPECT_EQ(Bits(outcome.motion), Bits(line));
}

TEST_F(PlannerTest, SlowsDownWhereAJointIsTooSlow) {
  Request request = ToTheSide(0.2, 0.1, 0.1);
  request.limits.joint = 0.4;
  const Outcome outcome = planner_.Plan(request, checker_, 1);

  ASSERT_EQ(outcome.kind, OutcomeKind::kStraight) << outcome.reason;
  EXPECT_GT(outcome.motion.steps(), StraightMotion(X_WE_home_, request.X_WE_goal, request.limits).steps());
  const auto joints = JointsAlong(outcome.motion, q_home_);
  for (std::size_t k = 12; k < joints.size(); ++k)
    EXPECT_LE((joints[k] - joints[k - 10]).cwiseAbs().maxCoeff() / (10 * kPeriod), 0.4 * 1.1);
}

TEST_F(PlannerTest, RefusesWhatNoSpeedMakesSmooth) {
  Request request = ToTheSide(0.2, 0.1, 0.1);
  request.limits.joint = 0.02;
  request.straight_only = true;
  const Outcome outcome = planner_.Plan(request, checker_, 1);

  EXPECT_EQ(outcome.kind, OutcomeKind::kNotSmooth);
  EXPECT_NE(outcome.reason.find("rad/s"), std::string::npos) << outcome.reason;
  EXPECT_EQ(outcome.motion.steps(), 0);
}

TEST_F(PlannerTest, SaysWhatBlocksTheStraightPath) {
  Request request = Blocked();
  request.straight_only = true;
  const Outcome outcome = planner_.Plan(request, checker_, 1);

  EXPECT_EQ(outcome.kind, OutcomeKind::kNoPath);
  EXPECT_NE(outcome.reason.find("bottle at "), std::string::npos) << outcome.reason;
  EXPECT_NE(outcome.reason.find("% of the straight path"), std::string::npos) << outcome.reason;
  EXPECT_EQ(outcome.samples, 0);
}

TEST_F(PlannerTest, GoesAroundAnObjectWithoutTouchingIt) {
  const Request request = Blocked();
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const Outcome outcome = planner_.Plan(request, checker_, seed);

    ASSERT_EQ(outcome.kind, OutcomeKind::kSampled) << outcome.reason;
    EXPECT_GT(outcome.samples, 0);
    EXPECT_EQ(outcome.motion.X_WE.back().p, request.X_WE_goal.p);
    EXPECT_EQ(outcome.motion.V_WE.back().norm(), 0);
    EXPECT_LT((outcome.motion.X_WE.front().p - X_WE_home_.p).norm(), 1e-6);
    ExpectWithinLimits(outcome.motion, request.limits);

    // a follower of the tool stays clear, looked at four times as closely as the planner samples
    const auto joints = JointsAlong(outcome.motion, q_home_);
    for (std::size_t k = 1; k < joints.size(); ++k) {
      const auto collision = checker_.CheckSegment(joints[k - 1], joints[k], PlannerConfig{}.resolution / 4);
      ASSERT_FALSE(collision) << collision->body_a << " " << collision->body_b << " at " << k;
      ASSERT_LE((joints[k] - joints[k - 1]).cwiseAbs().maxCoeff(), request.limits.joint * kPeriod * 1.1) << k;
    }
  }
}

TEST_F(PlannerTest, SampledVelocitiesAreTheDerivativesOfThePoses) {
  const Outcome outcome = planner_.Plan(Blocked(), checker_, 3);
  ASSERT_EQ(outcome.kind, OutcomeKind::kSampled) << outcome.reason;
  const Motion& motion = outcome.motion;
  for (int k = 1; k + 1 < motion.steps(); ++k) {
    const Eigen::Vector3d linear = (motion.X_WE[k + 1].p - motion.X_WE[k - 1].p) / (2 * kPeriod);
    EXPECT_LT((linear - motion.V_WE[k].head<3>()).norm(), 0.006) << k;
  }
}

TEST_F(PlannerTest, TheSimulatedArmFollowsSampledMotionsWithoutTouching) {
  const Request request = Blocked();
  sim::World world(scene_);
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    const Outcome outcome = planner_.Plan(request, checker_, seed);
    ASSERT_EQ(outcome.kind, OutcomeKind::kSampled) << outcome.reason;

    world.Reset();
    double x = 1;
    for (const sim::ObjectInfo& object : scene_->objects())
      world.SetObject(object.name, Standing(object.name, {x += 0.2, 1, 0}));
    world.SetObject("bottle", Standing("bottle", (X_WE_home_.p + request.X_WE_goal.p) / 2));
    world.SetArm(q_home_);
    world.Forward();
    double farthest = 0;
    for (int k = 0; k < outcome.motion.steps(); ++k) {
      world.Step({outcome.motion.X_WE[k], 0}, outcome.motion.V_WE[k]);
      farthest = std::max(farthest, (world.X_WE().p - outcome.motion.X_WE[k].p).norm());
      for (const std::string& other : world.ContactsOf("bottle")) ASSERT_EQ(other, "world") << k;
    }
    EXPECT_LT(farthest, 0.003);
    EXPECT_TRUE(world.healthy());
  }
}

TEST_F(PlannerTest, StartSpeedCarriesOver) {
  Request request = ToTheSide(0.2, 0.1, 0.1);
  request.start_speed = 0.15;
  const Outcome straight = planner_.Plan(request, checker_, 1);
  ASSERT_EQ(straight.kind, OutcomeKind::kStraight) << straight.reason;
  EXPECT_NEAR(straight.motion.V_WE.front().head<3>().norm(), 0.15, 1e-9);

  request = Blocked();
  request.start_speed = 0.05;
  const Outcome sampled = planner_.Plan(request, checker_, 1);
  ASSERT_EQ(sampled.kind, OutcomeKind::kSampled) << sampled.reason;
  const double speed = sampled.motion.V_WE.front().head<3>().norm();
  EXPECT_GT(speed, 0.01);
  EXPECT_LE(speed, 0.05 * 1.001);
}

TEST_F(PlannerTest, SaysWhenTheGoalIsInsideAnObject) {
  const Request request = ToTheSide(0.2, 0.1, 0);
  checker_.SetGripper(1);  // open fingers have room for it
  checker_.SetObject("bottle", Standing("bottle", request.X_WE_goal.p));
  const Outcome outcome = planner_.Plan(request, checker_, 1);

  EXPECT_EQ(outcome.kind, OutcomeKind::kGoalInCollision) << outcome.reason;
  EXPECT_NE(outcome.reason.find("bottle at the goal"), std::string::npos) << outcome.reason;
}

TEST_F(PlannerTest, AllowedContactsAndHeldObjectsDoNotBlock) {
  const Request request = ToTheSide(0.2, 0.1, 0);
  checker_.SetGripper(0.5);
  checker_.SetObject("bottle", Standing("bottle", request.X_WE_goal.p));
  checker_.Allow({"bottle"});
  EXPECT_EQ(planner_.Plan(request, checker_, 1).kind, OutcomeKind::kStraight);

  // the same object in the hand: free alone, blocked by what only it would meet
  checker_.Allow({});
  Pose X_EO;
  X_EO.q = X_WE_home_.q.conjugate();
  checker_.Attach("bottle", X_EO);
  EXPECT_EQ(planner_.Plan(request, checker_, 1).kind, OutcomeKind::kStraight);
  Eigen::Vector3d beyond = request.X_WE_goal.p;
  beyond.y() += 0.045;
  checker_.SetObject("cube", Standing("cube", beyond));
  const Outcome held = planner_.Plan(request, checker_, 1);
  EXPECT_EQ(held.kind, OutcomeKind::kGoalInCollision) << held.reason;
  EXPECT_NE(held.reason.find("bottle touches cube"), std::string::npos) << held.reason;
}

TEST_F(PlannerTest, SaysWhenTheGoalIsOutOfReach) {
  const Outcome outcome = planner_.Plan(ToTheSide(0, 3, 0), checker_, 1);

  EXPECT_EQ(outcome.kind, OutcomeKind::kGoalUnreachable) << outcome.reason;
  EXPECT_NE(outcome.reason.find("inverse kinematics"), std::string::npos);
  EXPECT_FALSE(outcome.planned());
}

TEST_F(PlannerTest, SaysWhenTheStartIsInCollision) {
  checker_.SetGripper(1);
  checker_.SetObject("bottle", Standing("bottle", X_WE_home_.p));
  const Outcome outcome = planner_.Plan(ToTheSide(0.2, 0.1, 0.1), checker_, 1);

  EXPECT_EQ(outcome.kind, OutcomeKind::kStartInCollision);
  EXPECT_NE(outcome.reason.find("bottle at the start"), std::string::npos) << outcome.reason;
}

TEST_F(PlannerTest, LeavesAStartThatIsNearerThanTheMargin) {
  // the fingers are nearer to the bottle than the margin; up and away is still allowed
  checker_.SetGripper(1);
  Pose X_WO = Standing("bottle", X_WE_home_.p);
  while (checker_.SetObject("bottle", X_WO), checker_.Check(q_home_)) X_WO.p.y() += 0.0005;
  ASSERT_TRUE(checker_.Check(q_home_, 0.002));

  const Outcome outcome = planner_.Plan(ToTheSide(0, -0.05, 0.02), checker_, 1);
  EXPECT_EQ(outcome.kind, OutcomeKind::kStraight) << outcome.reason;
}

TEST_F(PlannerTest, GivesUpWhenTheBudgetIsUsedUp) {
  PlannerConfig config;
  config.max_iterations = 3;
  Planner planner(scene_, config);
  // walls of objects all around the goal
  const Request request = ToTheSide(0.25, 0.12, 0);
  const char* names[] = {"bottle", "milk", "coke", "pepsi", "bread", "cube"};
  for (int i = 0; i < 6; ++i) {
    const double angle = 2 * M_PI * i / 6;
    checker_.SetObject(names[i], Standing(names[i], request.X_WE_goal.p +
                                                        0.09 * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0)));
  }
  const Outcome outcome = planner.Plan(request, checker_, 1);
  ASSERT_FALSE(outcome.planned()) << outcome.reason;
  if (outcome.kind == OutcomeKind::kNoPath) {
    EXPECT_LE(outcome.samples, 3);
  }

  // and one that is only blocked: three samples do not suffice for every seed
  for (const char* name : names) checker_.SetObject(name, Standing(name, {5, 5, 0}));
  const Request blocked = Blocked();
  int given_up = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Outcome few = planner.Plan(blocked, checker_, seed);
    EXPECT_LE(few.samples, 3);
    if (few.kind != OutcomeKind::kNoPath) continue;
    ++given_up;
    EXPECT_NE(few.reason.find("no path in 3 samples"), std::string::npos) << few.reason;
  }
  EXPECT_GT(given_up, 0);
}

TEST_F(PlannerTest, SameSeedSameBitsWhateverWasPlannedBefore) {
  const Request request = Blocked();
  const Outcome first = planner_.Plan(request, checker_, 5);
  ASSERT_EQ(first.kind, OutcomeKind::kSampled) << first.reason;

  // other seeds, other scenes, in the same process and by the same objects
  std::vector<double> other_bits;
  for (std::uint64_t seed = 10; seed < 14; ++seed) other_bits = Bits(planner_.Plan(request, checker_, seed).motion);
  EXPECT_NE(other_bits, Bits(first.motion));
  checker_.SetObject("milk", Standing("milk", {0.3, 0.5, 0}));
  planner_.Plan(ToTheSide(-0.2, 0.1, 0.1), checker_, 6);
  checker_.SetObject("milk", Standing("milk", {5, 5, 0}));

  const Outcome again = planner_.Plan(request, checker_, 5);
  EXPECT_EQ(Bits(again.motion), Bits(first.motion));
  EXPECT_EQ(again.samples, first.samples);

  collide::Checker fresh_checker(scene_);
  fresh_checker.SetObject("bottle", Standing("bottle", (X_WE_home_.p + request.X_WE_goal.p) / 2));
  Planner fresh(scene_);
  EXPECT_EQ(Bits(fresh.Plan(request, fresh_checker, 5).motion), Bits(first.motion));
}

TEST(OutcomeKind, HasStableNames) {
  EXPECT_EQ(ToString(OutcomeKind::kStraight), "straight");
  EXPECT_EQ(ToString(OutcomeKind::kSampled), "sampled");
  EXPECT_EQ(ToString(OutcomeKind::kField), "field");
  EXPECT_EQ(ToString(OutcomeKind::kFieldEscaped), "field_escaped");
  EXPECT_EQ(ToString(OutcomeKind::kGoalUnreachable), "goal_unreachable");
  EXPECT_EQ(ToString(OutcomeKind::kGoalInCollision), "goal_in_collision");
  EXPECT_EQ(ToString(OutcomeKind::kStartInCollision), "start_in_collision");
  EXPECT_EQ(ToString(OutcomeKind::kNoPath), "no_path");
  EXPECT_EQ(ToString(OutcomeKind::kNotSmooth), "not_smooth");
}

}  // namespace planner_test
}  // namespace etude::plan
