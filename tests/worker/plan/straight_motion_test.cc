// SPDX-License-Identifier: Apache-2.0
// Tests worker/plan/line_motion.cc
#include <gtest/gtest.h>

#include <cmath>

#include "services/core/rng.h"
#include "worker/plan/planner.h"

namespace etude::plan {
namespace straight_motion_test {

constexpr double kPeriod = 1 / kControlRate;

Pose RandomPose(Rng& rng, double reach, double turn) {
  Pose X;
  X.p = {rng.Uniform(-reach, reach), rng.Uniform(-reach, reach), rng.Uniform(-reach, reach)};
  X.q = FromEuler({rng.Uniform(-turn, turn), rng.Uniform(-turn, turn), rng.Uniform(-turn, turn)});
  return X;
}

Eigen::Vector3d RotationVector(const Eigen::Quaterniond& from, const Eigen::Quaterniond& to) {
  const Eigen::AngleAxisd turn(to * from.conjugate());
  const double angle = turn.angle() > M_PI ? turn.angle() - 2 * M_PI : turn.angle();
  return turn.axis() * angle;
}

TEST(StraightMotion, KeepsTheLimitsAndEndsAtRestExactlyAtTheGoal) {
  Rng rng(1);
  const Limits limits;
  for (int i = 0; i < 300; ++i) {
    const Pose start = RandomPose(rng, 0.3, 1), goal = RandomPose(rng, 0.3, 1);
    const Motion motion = StraightMotion(start, goal, limits);

    ASSERT_GE(motion.steps(), 2);
    ASSERT_EQ(motion.X_WE.size(), motion.V_WE.size());
    EXPECT_LT((motion.X_WE.front().p - start.p).norm(), 1e-12);
    EXPECT_LT(AngleBetween(motion.X_WE.front().q, start.q), 1e-7);
    EXPECT_EQ(motion.X_WE.back().p, goal.p);
    EXPECT_EQ(motion.X_WE.back().q.coeffs(), goal.q.coeffs());
    EXPECT_EQ(motion.V_WE.back().norm(), 0);
    EXPECT_EQ(motion.V_WE.front().norm(), 0);
    for (int k = 0; k < motion.steps(); ++k) {
      EXPECT_LE(motion.V_WE[k].head<3>().norm(), limits.linear * (1 + 1e-9));
      EXPECT_LE(motion.V_WE[k].tail<3>().norm(), limits.angular * (1 + 1e-9));
      if (k == 0) continue;
      const Eigen::Matrix<double, 6, 1> change = motion.V_WE[k] - motion.V_WE[k - 1];
      EXPECT_LE(change.head<3>().norm(), limits.linear_accel * kPeriod * (1 + 1e-6));
      EXPECT_LE(change.tail<3>().norm(), limits.angular_accel * kPeriod * (1 + 1e-6));
    }
  }
}

TEST(StraightMotion, VelocitiesAreTheDerivativesOfThePoses) {
  Rng rng(2);
  const Limits limits;
  for (int i = 0; i < 100; ++i) {
    const Motion motion = StraightMotion(RandomPose(rng, 0.3, 1), RandomPose(rng, 0.3, 1), limits);
    for (int k = 1; k + 1 < motion.steps(); ++k) {
      const Eigen::Vector3d linear = (motion.X_WE[k + 1].p - motion.X_WE[k - 1].p) / (2 * kPeriod);
      const Eigen::Vector3d angular = RotationVector(motion.X_WE[k - 1].q, motion.X_WE[k + 1].q) / (2 * kPeriod);
      // a central difference across a kink of the trapezoid is off by at most a quarter step of it
      EXPECT_LT((linear - motion.V_WE[k].head<3>()).norm(), limits.linear_accel * kPeriod / 4 + 1e-9);
      EXPECT_LT((angular - motion.V_WE[k].tail<3>()).norm(), limits.angular_accel * kPeriod / 4 + 1e-6);
    }
  }
}

TEST(StraightMotion, PositionAndRotationShareOneParameter) {
  Pose start, goal;
  goal.p = {0.3, -0.1, 0.2};
  goal.q = FromEuler({0.4, 0.5, -0.6});
  const Motion motion = StraightMotion(start, goal, Limits{});
  const double angle = AngleBetween(start.q, goal.q);
  for (const Pose& X_WE : motion.X_WE) {
    const double s = X_WE.p.norm() / goal.p.norm();
    EXPECT_LT((X_WE.p - s * goal.p).norm(), 1e-12);
    EXPECT_NEAR(AngleBetween(start.q, X_WE.q), s * angle, 1e-7);
    EXPECT_NEAR(AngleBetween(X_WE.q, goal.q), (1 - s) * angle, 1e-7);
  }
}

TEST(StraightMotion, TurnsTheShortWay) {
  Pose start, goal;
  goal.q = FromEuler({0, 0, 0.5});
  goal.q.coeffs() *= -1;
  for (const auto& V_WE : StraightMotion(start, goal, Limits{}).V_WE) EXPECT_GE(V_WE[5], 0);
}

TEST(StraightMotion, BlendsFromTheSpeedOfTheStageBefore) {
  Pose start, goal;
  goal.p = {0, 0.2, 0};
  const Limits limits;
  const Motion motion = StraightMotion(start, goal, limits, 0.2);
  EXPECT_NEAR(motion.V_WE.front()[1], 0.2, 1e-12);
  EXPECT_LT(motion.steps(), StraightMotion(start, goal, limits).steps());
  for (int k = 1; k < motion.steps(); ++k)
    EXPECT_LE((motion.V_WE[k] - motion.V_WE[k - 1]).norm(), limits.linear_accel * kPeriod * (1 + 1e-6));

  // a stage that is slower than the one before brakes down to its own speed
  Limits slow = limits;
  slow.linear = 0.05;
  const Motion braked = StraightMotion(start, goal, slow, 0.2);
  EXPECT_NEAR(braked.V_WE.front()[1], 0.2, 1e-12);
  EXPECT_LE(braked.V_WE[braked.steps() / 2].norm(), 0.05 * (1 + 1e-9));
}

TEST(StraightMotion, StopsWithinAShortWay) {
  Pose start, goal;
  goal.p = {0, 0.008, 0};
  const Motion motion = StraightMotion(start, goal, Limits{}, 0.2);
  EXPECT_EQ(motion.X_WE.back().p, goal.p);
  EXPECT_GT(motion.V_WE.front()[1], 0.15);
  for (int k = 1; k < motion.steps(); ++k)
    EXPECT_LE((motion.V_WE[k] - motion.V_WE[k - 1]).norm(), 2.1 * Limits{}.linear_accel * kPeriod);
}

// The shortest time that the limits allow, rounded up to a control step: of the slower of both, way and turn.
TEST(StraightMotion, TakesAsLongAsTheSlowerOfWayAndTurn) {
  Rng rng(8);
  const auto shortest = [](double length, double speed, double accel) {
    return speed * speed / accel >= length ? 2 * std::sqrt(length / accel) : length / speed + speed / accel;
  };
  const Limits limits;
  for (int i = 0; i < 200; ++i) {
    const Pose start = RandomPose(rng, 0.3, 1), goal = RandomPose(rng, 0.3, 1);
    const double length = (goal.p - start.p).norm(), angle = AngleBetween(start.q, goal.q);
    const double speed = std::min(limits.linear / length, limits.angular / angle);
    const double accel = std::min(limits.linear_accel / length, limits.angular_accel / angle);
    const int steps = StraightMotion(start, goal, limits).steps() - 1;
    EXPECT_EQ(steps, static_cast<int>(std::ceil(shortest(1, speed, accel) / kPeriod - 1e-6)));
    EXPECT_GE((steps + 1e-6) * kPeriod, shortest(length, limits.linear, limits.linear_accel));
    EXPECT_GE((steps + 1e-6) * kPeriod, shortest(angle, limits.angular, limits.angular_accel));
  }
}

TEST(Motion, BetweenItsSamplesItIsInterpolatedAndBeyondThemItStays) {
  Rng rng(9);
  const Motion motion = StraightMotion(RandomPose(rng, 0.3, 1), RandomPose(rng, 0.3, 1), Limits{});
  const int last = motion.steps() - 1;
  EXPECT_EQ(motion.At(-3).p, motion.X_WE.front().p);
  EXPECT_EQ(motion.At(last + 7.5).p, motion.X_WE.back().p);
  for (int k = 0; k < last; ++k)
    for (const double share : {0.0, 0.25, 0.5}) {
      const Pose &from = motion.X_WE[k], &to = motion.X_WE[k + 1], at = motion.At(k + share);
      EXPECT_LT((at.p - (from.p + share * (to.p - from.p))).norm(), 1e-12);
      EXPECT_NEAR(AngleBetween(from.q, at.q), share * AngleBetween(from.q, to.q), 1e-7);
    }
}

TEST(Brake, StopsOnThePathWithinTheLimits) {
  Rng rng(10);
  const Limits limits;
  for (int i = 0; i < 50; ++i) {
    const Pose start = RandomPose(rng, 0.4, 0.5), goal = RandomPose(rng, 0.4, 0.5);
    const Motion motion = StraightMotion(start, goal, limits);
    for (const int step : {0, motion.steps() / 3, motion.steps() / 2, motion.steps() - 1}) {
      const Motion brake = Brake(motion, step, limits);
      EXPECT_EQ(brake.X_WE.front().p, motion.X_WE[step].p);
      EXPECT_EQ(brake.V_WE.front(), motion.V_WE[step]);
      EXPECT_EQ(brake.V_WE.back().norm(), 0);
      const double speed = motion.V_WE[step].head<3>().norm(), turn = motion.V_WE[step].tail<3>().norm();
      const double seconds = std::max(speed / limits.linear_accel, turn / limits.angular_accel);
      EXPECT_EQ(brake.steps() - 1, static_cast<int>(std::ceil(seconds / kPeriod))) << "at once";
      const Eigen::Vector3d along = (goal.p - start.p).normalized();
      for (const Pose& X_WE : brake.X_WE) {
        EXPECT_LT((X_WE.p - start.p).cross(along).norm(), 1e-9) << "off the path";
        EXPECT_LE((X_WE.p - motion.X_WE[step].p).dot(along), speed * seconds / 2 + speed * kPeriod + 1e-9);
      }
    }
  }
}

TEST(StraightMotion, ToWhereItIsHasOneSample) {
  Pose here;
  here.p = {0.1, 0.2, 0.3};
  const Motion motion = StraightMotion(here, here, Limits{}, 0.1);
  ASSERT_EQ(motion.steps(), 1);
  EXPECT_EQ(motion.X_WE[0].p, here.p);
  EXPECT_EQ(motion.V_WE[0].norm(), 0);
}

}  // namespace straight_motion_test
}  // namespace etude::plan
