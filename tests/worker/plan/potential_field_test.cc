// SPDX-License-Identifier: Apache-2.0
// Tests worker/plan/potential_field.cc, worker/plan/planner_field.cc and worker/plan/replan.cc
#include "worker/plan/potential_field.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "services/core/rng.h"
#include "tests/worker/plan/motion_bits.h"
#include "tests/worker/plan/plan_fixture.h"
#include "worker/plan/planner.h"

namespace etude::plan {
namespace potential_field_test {

constexpr double kPeriod = 1 / kControlRate;

class FieldTest : public PlanFixture {
 protected:
  Request ToTheSide(double dx, double dy, double dz) const {
    Request request = PlanFixture::ToTheSide(dx, dy, dz);
    request.method = Method::kPotentialField;
    return request;
  }

  // The cube, 5 cm wide, somewhere in the air.
  void Place(const std::string& name, const Eigen::Vector3d& p) {
    Pose X_WO;
    X_WO.p = p;
    checker_.SetObject(name, X_WO);
  }

  // Least distance between the arm and `object` along a motion; negative in contact.
  double Clearance(const Motion& motion, const Eigen::VectorXd& q_start, const std::string& object) {
    double least = 1;
    for (const Eigen::VectorXd& q : JointsAlong(motion, q_start))
      for (const collide::Proximity& pair : checker_.Distances(q, 0.2))
        if (pair.body_b == object) least = std::min(least, pair.distance);
    return least;
  }

  void ExpectFree(const Motion& motion, const Eigen::VectorXd& q_start) {
    const auto joints = JointsAlong(motion, q_start);
    for (std::size_t k = 1; k < joints.size(); ++k) {
      const auto collision = checker_.CheckSegment(joints[k - 1], joints[k], PlannerConfig{}.resolution / 4);
      ASSERT_FALSE(collision) << collision->body_a << " " << collision->body_b << " at " << k;
      for (Eigen::Index i = 0; i < joints[k].size(); ++i) {
        ASSERT_GE(joints[k][i], scene_->arm().q_min[i]);
        ASSERT_LE(joints[k][i], scene_->arm().q_max[i]);
      }
    }
  }

  void ExpectSmooth(const Motion& motion, const Limits& limits) {
    for (int k = 1; k < motion.steps(); ++k) {
      EXPECT_LE(motion.V_WE[k].head<3>().norm(), limits.linear * 1.01) << k;
      const Eigen::Matrix<double, 6, 1> change = (motion.V_WE[k] - motion.V_WE[k - 1]) / kPeriod;
      EXPECT_LE(change.head<3>().norm(), limits.linear_accel * 1.2) << k;
      const Eigen::Vector3d mean = (motion.V_WE[k].head<3>() + motion.V_WE[k - 1].head<3>()) / 2;
      EXPECT_LT(((motion.X_WE[k].p - motion.X_WE[k - 1].p) / kPeriod - mean).norm(), 0.02) << k;
    }
  }
};

TEST_F(FieldTest, EndsAtTheGoalWhereNothingIsInTheWay) {
  const Request request = ToTheSide(0.2, 0.1, 0.1);
  const Outcome outcome = planner_.Plan(request, checker_, 1);

  ASSERT_EQ(outcome.kind, OutcomeKind::kField) << outcome.reason;
  EXPECT_EQ(outcome.samples, 0);
  EXPECT_LT((outcome.motion.X_WE.front().p - X_WE_home_.p).norm(), 1e-6);
  EXPECT_EQ(outcome.motion.X_WE.back().p, request.X_WE_goal.p);
  EXPECT_EQ(outcome.motion.V_WE.back().norm(), 0);
  ExpectFree(outcome.motion, q_home_);
  ExpectSmooth(outcome.motion, request.limits);
  // nothing repels: the tool goes straight
  const Eigen::ParametrizedLine<double, 3> line =
      Eigen::ParametrizedLine<double, 3>::Through(X_WE_home_.p, request.X_WE_goal.p);
  for (const Pose& X_WE : outcome.motion.X_WE) EXPECT_LT(line.distance(X_WE.p), 0.02);
}

// before, it ended the process: there is nothing to smooth
TEST_F(FieldTest, ToWhereItIsHasOneSample) {
  Request request = ToTheSide(0.2, 0.1, 0.1);
  request.X_WE_goal = X_WE_home_;
  const Outcome outcome = planner_.Plan(request, checker_, 1);

  ASSERT_EQ(outcome.kind, OutcomeKind::kField) << outcome.reason;
  EXPECT_EQ(outcome.motion.steps(), 1);
  EXPECT_EQ(outcome.motion.X_WE.back().p, X_WE_home_.p);
}

TEST_F(FieldTest, KeepsClearOfWhatTheStraightLineWouldTouch) {
  Request request = ToTheSide(0.35, 0.05, 0.12);
  request.clearance = 0.06;
  Place("cube", (X_WE_home_.p + request.X_WE_goal.p) / 2 + Eigen::Vector3d(0, 0.04, 0));

  Request straight = request;
  straight.method = Method::kStraightFirst;
  const Outcome line = planner_.Plan(straight, checker_, 1);
  const Outcome outcome = planner_.Plan(request, checker_, 1);
  ASSERT_TRUE(outcome.planned()) << outcome.reason;
  ExpectFree(outcome.motion, q_home_);
  ExpectSmooth(outcome.motion, request.limits);
  const double kept = Clearance(outcome.motion, q_home_, "cube");
  EXPECT_GT(kept, 0.02) << ToString(outcome.kind) << " " << outcome.reason;
  if (line.planned()) {
    EXPECT_GT(kept, Clearance(line.motion, q_home_, "cube") + 0.01);
  }
}

TEST_F(FieldTest, OnlyNamedObstaclesAreKeptAwayFrom) {
  Request request = ToTheSide(0.3, 0.0, 0.15);
  request.clearance = 0.10;
  Place("cube", (X_WE_home_.p + request.X_WE_goal.p) / 2 + Eigen::Vector3d(0, 0.06, 0));
  request.obstacles = {"coke"};
  const Outcome near = planner_.Plan(request, checker_, 1);
  request.obstacles = {"cube"};
  const Outcome far = planner_.Plan(request, checker_, 1);

  ASSERT_EQ(near.kind, OutcomeKind::kField) << near.reason;
  ASSERT_TRUE(far.planned()) << far.reason;
  EXPECT_GT(Clearance(far.motion, q_home_, "cube"), Clearance(near.motion, q_home_, "cube") + 0.01);
}

TEST_F(FieldTest, ReachesAGoalBesideAnObstacle) {
  // the hand ends within the clearance of what it must not touch: the field still ends there
  Request request = ToTheSide(0.2, 0.05, 0.05);
  request.clearance = 0.08;
  Place("cube", request.X_WE_goal.p + Eigen::Vector3d(0, 0.06, 0));
  const Outcome outcome = planner_.Plan(request, checker_, 1);

  ASSERT_TRUE(outcome.planned()) << outcome.reason;
  EXPECT_EQ(outcome.motion.X_WE.back().p, request.X_WE_goal.p);
  ExpectFree(outcome.motion, q_home_);
}

TEST_F(FieldTest, StaysWithinJointLimits) {
  // the flow alone, with limits right beside the way
  const Request request = ToTheSide(-0.25, 0.05, 0.1);
  const auto q_goal = kinematics_.Solve(request.X_WE_goal, q_home_);
  ASSERT_TRUE(q_goal);
  const internal::Influence influence(checker_, {q_home_, X_WE_home_}, {*q_goal, request.X_WE_goal}, 0.05, {});
  internal::FieldProblem problem{.q_start = q_home_,
                                 .X_WE_goal = request.X_WE_goal,
                                 .q_min = q_home_.cwiseMin(*q_goal).array() - 0.03,
                                 .q_max = q_home_.cwiseMax(*q_goal).array() + 0.03,
                                 .influence = &influence,
                                 .is_free = [](const Eigen::VectorXd&) { return true; }};
  const internal::FieldResult result = internal::FollowField(problem, kinematics_, checker_);
  ASSERT_GT(result.path.size(), 20u);
  for (const Eigen::VectorXd& q : result.path) {
    EXPECT_TRUE((q.array() >= problem.q_min.array() - 1e-12).all());
    EXPECT_TRUE((q.array() <= problem.q_max.array() + 1e-12).all());
  }
  for (std::size_t k = 1; k < result.path.size(); ++k)
    EXPECT_LE((result.path[k] - result.path[k - 1]).cwiseAbs().maxCoeff(), 0.05 + 1e-12);
}

TEST_F(FieldTest, LeavesTrapsThroughSampling) {
  // pockets across the way, nearer or further: a wall and, over the hand, a roof
  const Request request = ToTheSide(0.36, 0.0, 0.04);
  int pockets = 0, escaped = 0;
  for (int i = 0; i < 12; ++i) {
    const double wall = 0.15 + 0.02 * (i % 3), roof = 0.13 + 0.01 * (i / 3);
    const char* names[] = {"milk", "coke", "pepsi", "bread", "bottle", "cube"};
    for (int k = 0; k < 3; ++k) Place(names[k], X_WE_home_.p + Eigen::Vector3d(wall, 0.09 * k - 0.11, 0.0));
    for (int k = 0; k < 3; ++k) Place(names[3 + k], X_WE_home_.p + Eigen::Vector3d(wall - 0.05, 0.09 * k - 0.11, roof));
    if (checker_.Check(q_home_, 0.005)) continue;
    ++pockets;
    const Outcome outcome = planner_.Plan(request, checker_, i);
    ASSERT_TRUE(outcome.planned()) << i << " " << outcome.reason;
    EXPECT_EQ(outcome.motion.X_WE.back().p, request.X_WE_goal.p);
    ExpectFree(outcome.motion, q_home_);
    ExpectSmooth(outcome.motion, request.limits);
    if (outcome.kind != OutcomeKind::kFieldEscaped) continue;
    ++escaped;
    EXPECT_GT(outcome.samples, 0);
    EXPECT_NE(outcome.reason.find("held at "), std::string::npos) << outcome.reason;
  }
  EXPECT_GT(pockets, 5);
  EXPECT_GT(escaped, 3);
}

TEST_F(FieldTest, SameSeedSameBitsWhateverWasPlannedBefore) {
  const Request request = ToTheSide(0.36, 0.0, 0.04);
  const Eigen::Vector3d middle = (X_WE_home_.p + request.X_WE_goal.p) / 2;
  Place("milk", middle);
  const Outcome first = planner_.Plan(request, checker_, 5);
  ASSERT_TRUE(first.planned()) << first.reason;

  planner_.Plan(ToTheSide(-0.2, 0.1, 0.1), checker_, 6);
  Place("coke", {0.3, 0.5, 0.1});
  planner_.Plan(request, checker_, 7);
  Place("coke", {5, 5, 0.1});
  EXPECT_EQ(Bits(planner_.Plan(request, checker_, 5).motion), Bits(first.motion));

  collide::Checker fresh_checker(scene_);
  Pose X_WO;
  X_WO.p = middle;
  fresh_checker.SetObject("milk", X_WO);
  Planner fresh(scene_);
  EXPECT_EQ(Bits(fresh.Plan(request, fresh_checker, 5).motion), Bits(first.motion));
}

TEST_F(FieldTest, PlansAroundABodyBetweenStartAndGoalInTwoHundredScenes) {
  Rng rng(11);
  int scenes = 0, planned = 0, field = 0, escaped = 0;
  std::vector<double> clearances;
  while (scenes < 200) {
    Request request = ToTheSide(0, 0, 0);
    request.X_WE_goal.p = {rng.Uniform(-0.35, 0.35), rng.Uniform(0.18, 0.34), rng.Uniform(0.07, 0.2)};
    if ((request.X_WE_goal.p - X_WE_home_.p).norm() < 0.2 || !kinematics_.Solve(request.X_WE_goal, q_home_)) continue;
    const double part = rng.Uniform(0.35, 0.65);
    // ahead of the tips: the hand reaches that far beyond its frame
    Place("cube",
          X_WE_home_.p + part * (request.X_WE_goal.p - X_WE_home_.p) +
              Eigen::Vector3d(rng.Uniform(-0.03, 0.03), 0.02 + rng.Uniform(-0.03, 0.03), rng.Uniform(-0.03, 0.03)));
    if (checker_.Check(q_home_, 0.005)) continue;
    const auto q_goal = kinematics_.Solve(request.X_WE_goal, q_home_);
    if (checker_.Check(*q_goal, 0.005)) continue;
    ++scenes;
    const Outcome outcome = planner_.Plan(request, checker_, scenes);
    if (!outcome.planned()) continue;
    ++planned;
    field += outcome.kind == OutcomeKind::kField ? 1 : 0;
    escaped += outcome.kind == OutcomeKind::kFieldEscaped ? 1 : 0;
    ExpectFree(outcome.motion, q_home_);
    clearances.push_back(Clearance(outcome.motion, q_home_, "cube"));
    EXPECT_GT(clearances.back(), 0) << scenes;
  }
  std::ranges::sort(clearances);
  RecordProperty("planned", planned);
  RecordProperty("field", field);
  RecordProperty("escaped", escaped);
  RecordProperty("median_clearance_mm", static_cast<int>(1e3 * clearances[clearances.size() / 2]));
  EXPECT_EQ(planned, 200);
  EXPECT_GT(field, 120);
  EXPECT_GT(clearances[clearances.size() / 2], 0.015);
}

TEST_F(FieldTest, BrakesToRestAlongTheMotion) {
  const Request request = ToTheSide(0.3, 0.1, 0.1);
  const Motion motion = planner_.Plan(request, checker_, 1).motion;
  ASSERT_GT(motion.steps(), 60);
  const Motion brake = Brake(motion, motion.steps() / 2, request.limits);

  EXPECT_EQ(brake.X_WE.front().p, motion.X_WE[motion.steps() / 2].p);
  EXPECT_EQ(brake.V_WE.front(), motion.V_WE[motion.steps() / 2]);
  EXPECT_EQ(brake.V_WE.back().norm(), 0);
  EXPECT_LT(brake.steps(), 40);
  ExpectSmooth(brake, request.limits);
  EXPECT_EQ(Brake(motion, 0, request.limits).steps(), 1) << "at rest already";
}

TEST_F(FieldTest, SeesWhenTheRestOfAMotionIsNotFreeAnyMore) {
  const Request request = ToTheSide(0.35, 0.05, 0.12);
  const Motion motion = planner_.Plan(request, checker_, 1).motion;
  ASSERT_GT(motion.steps(), 60);
  EXPECT_FALSE(planner_.FindBlockage(motion, 0, q_home_, checker_));

  Place("cube", motion.X_WE[motion.steps() / 2].p);
  const auto blockage = planner_.FindBlockage(motion, 0, q_home_, checker_);
  ASSERT_TRUE(blockage);
  EXPECT_GT(blockage->step, 0);
  EXPECT_LT(blockage->step, motion.steps() * 3 / 4);
  EXPECT_NE(blockage->reason.find("cube"), std::string::npos) << blockage->reason;

  // behind the hand it does not matter
  const int late = motion.steps() * 9 / 10;
  const Eigen::VectorXd q = JointsAlong(motion, q_home_)[late];
  ASSERT_FALSE(checker_.Check(q));
  EXPECT_FALSE(planner_.FindBlockage(motion, late, q, checker_));
}

TEST_F(FieldTest, AvoidsAnObstacleThatMovesIntoTheWay) {
  Rng rng(12);
  int moved = 0, replanned = 0;
  for (int scene = 0; scene < 30; ++scene) {
    Place("cube", {5, 5, 0.1});
    const double side = scene % 2 == 0 ? 1 : -1;
    const Request request = ToTheSide(side * rng.Uniform(0.28, 0.36), rng.Uniform(0.0, 0.08), rng.Uniform(0.08, 0.15));
    Motion motion = planner_.Plan(request, checker_, scene).motion;
    ASSERT_GT(motion.steps(), 60);
    const Eigen::Vector3d target = motion.X_WE[motion.steps() * 3 / 4].p;
    Eigen::Vector3d p = target + Eigen::Vector3d(0, 0.15, 0);  // there in 0.6 s, before the arm
    Eigen::VectorXd q = q_home_;
    ++moved;
    bool contact = false, gave_up = false;
    for (int step = 0; step < motion.steps() && step < 2000; ++step) {
      p += Eigen::Vector3d(0, -0.25, 0) * kPeriod;
      if (p.y() < target.y()) p.y() = target.y();
      Place("cube", p);
      q = kinematics_.Solve(motion.X_WE[step], q).value_or(q);
      contact = contact || checker_.Check(q).has_value();
      if (step % 10 != 0 || !planner_.FindBlockage(motion, step, q, checker_, 0.01)) continue;
      const Outcome next = planner_.Replan(motion, step, q, request, checker_, 100 * scene + step);
      if (!next.planned()) {
        gave_up = true;  // the goal itself may be taken: stop
        break;
      }
      EXPECT_EQ(next.motion.X_WE.front().p, motion.X_WE[step].p);
      EXPECT_EQ(next.motion.V_WE.front(), motion.V_WE[step]);
      motion = next.motion;
      step = 0;
      ++replanned;
    }
    EXPECT_FALSE(contact) << scene;
    if (!gave_up) {
      EXPECT_LT((kinematics_.X_WE(q).p - request.X_WE_goal.p).norm(), 1e-3) << scene;
    }
  }
  EXPECT_GT(replanned, 5);
}

}  // namespace potential_field_test
}  // namespace etude::plan
