// SPDX-License-Identifier: Apache-2.0
// Tests worker/plan/retime.cc
#include "worker/plan/retime.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/worker/plan/motion_bits.h"
#include "tests/worker/plan/plan_fixture.h"

namespace etude::plan {
namespace retime_test {

using internal::JointCurve;
using internal::Retime;

constexpr double kPeriod = 1 / kControlRate;

class RetimeTest : public PlanFixture {
 protected:
  Eigen::VectorXd Away(std::initializer_list<double> offsets) const {
    Eigen::VectorXd q = q_home_;
    int joint = 0;
    for (const double offset : offsets) q[joint++] += offset;
    return q;
  }
  // Round two corners.
  JointCurve Bent() const {
    return JointCurve({q_home_, Away({0.3, -0.2, 0.1}), Away({0.5, 0.1, -0.1, 0.3}), Away({0.5, 0.1, -0.2, 0.3, 0.4})},
                      0.1);
  }
  Pose EndOf(const JointCurve& curve) { return kinematics_.X_WE(curve.At(1).q); }
  Motion MustRetime(const JointCurve& curve, const Limits& limits, double start_speed = 0) {
    const auto motion = Retime(curve, kinematics_, limits, start_speed, EndOf(curve));
    EXPECT_TRUE(motion);
    return motion.value_or(Motion{});
  }
  static double SecondsOf(const Motion& motion) { return (motion.steps() - 1) * kPeriod; }
};

// Limits that nothing meets but what a test sets.
Limits Loose() { return {.linear = 1e3, .angular = 1e3, .linear_accel = 1e6, .angular_accel = 1e6, .joint = 1e3}; }

// One joint that is bounded by its speed alone: 8 of its speeds a second up, cruise, and down again.
TEST_F(RetimeTest, AStraightJointPathTakesTheTimeOfATrapezoid) {
  for (const double speed : {0.2, 0.5, 1.0}) {
    Limits limits = Loose();
    limits.joint = speed;
    const double way = 0.8, accel = 8 * speed;
    const double shortest = way / speed + speed / accel;
    ASSERT_GT(way, speed * speed / accel) << "it comes to its cruise speed";
    const Motion motion = MustRetime(JointCurve({q_home_, Away({way})}, 0.1), limits);
    EXPECT_GE(SecondsOf(motion), shortest - 1e-9) << speed;
    EXPECT_LE(SecondsOf(motion), 1.02 * shortest + kPeriod) << speed;
  }
}

TEST_F(RetimeTest, KeepsTheLimitsOfToolAndJoints) {
  const Limits limits;
  const JointCurve curve = Bent();
  const Motion motion = MustRetime(curve, limits);
  ASSERT_GT(motion.steps(), 50);
  for (int k = 1; k < motion.steps(); ++k) {
    const Eigen::Vector3d moved = motion.X_WE[k].p - motion.X_WE[k - 1].p;
    EXPECT_LE(moved.norm(), limits.linear * kPeriod * 1.01) << k;
    EXPECT_LE(AngleBetween(motion.X_WE[k].q, motion.X_WE[k - 1].q), limits.angular * kPeriod * 1.01) << k;
    const Eigen::Matrix<double, 6, 1> change = (motion.V_WE[k] - motion.V_WE[k - 1]) / kPeriod;
    EXPECT_LE(change.head<3>().norm(), limits.linear_accel * 1.1) << k;
    EXPECT_LE(change.tail<3>().norm(), limits.angular_accel * 1.1) << k;
  }
  const auto joints = JointsAlong(motion, q_home_);
  for (std::size_t k = 2; k < joints.size(); ++k)
    EXPECT_LE((joints[k] - joints[k - 1]).cwiseAbs().maxCoeff(), limits.joint * kPeriod * 1.02) << k;
}

TEST_F(RetimeTest, SomeLimitIsMetAtSomeTime) {
  // faster would break one: else it would be slower than it may be
  const Limits limits;
  const Motion motion = MustRetime(Bent(), limits);
  double most = 0;
  for (const auto& V_WE : motion.V_WE)
    most = std::max({most, V_WE.head<3>().norm() / limits.linear, V_WE.tail<3>().norm() / limits.angular});
  EXPECT_GT(most, 0.9);
}

TEST_F(RetimeTest, FollowsItsCurveFromEndToEnd) {
  const JointCurve curve = Bent();
  const Motion motion = MustRetime(curve, Limits{});
  const Pose start = kinematics_.X_WE(curve.At(0).q), end = EndOf(curve);
  EXPECT_LT((motion.X_WE.front().p - start.p).norm(), 1e-9);
  EXPECT_EQ(motion.X_WE.back().p, end.p);
  EXPECT_EQ(motion.V_WE.front().norm(), 0);
  EXPECT_EQ(motion.V_WE.back().norm(), 0);
  // every pose is one of the curve's, and they come in its order
  double along = 0;
  for (const Pose& X_WE : motion.X_WE) {
    double best = 1e9, at = along;
    for (double u = along; u <= std::min(1.0, along + 0.1); u += 5e-4) {
      const double off = (kinematics_.X_WE(curve.At(u).q).p - X_WE.p).norm();
      if (off < best) best = off, at = u;
    }
    EXPECT_LT(best, 1e-3);
    along = at;
  }
  EXPECT_GT(along, 0.99);
}

TEST_F(RetimeTest, VelocitiesAreTheDerivativesOfThePoses) {
  const Motion motion = MustRetime(Bent(), Limits{});
  for (int k = 1; k + 1 < motion.steps(); ++k) {
    const Eigen::Vector3d linear = (motion.X_WE[k + 1].p - motion.X_WE[k - 1].p) / (2 * kPeriod);
    EXPECT_LT((linear - motion.V_WE[k].head<3>()).norm(), 0.006) << k;
  }
}

// Times are 1/c when speeds are c and accelerations c^2 times as large.
TEST_F(RetimeTest, TimeScalesWithTheLimits) {
  const JointCurve curve = Bent();
  Limits limits;
  limits.joint = 1e3;
  const double seconds = SecondsOf(MustRetime(curve, limits));
  for (const double c : {0.25, 0.5, 2.0}) {
    Limits scaled = limits;
    for (double* speed : {&scaled.linear, &scaled.angular}) *speed *= c;
    for (double* accel : {&scaled.linear_accel, &scaled.angular_accel}) *accel *= c * c;
    // joints may reach their limit in an eighth of a second, whatever it is: it must be out of the way
    scaled.joint = 1e4;
    EXPECT_NEAR(SecondsOf(MustRetime(curve, scaled)) * c, seconds, (1 + c) * kPeriod) << c;
  }
}

TEST_F(RetimeTest, ThereAndBackTakeTheSameTime) {
  const std::vector<Eigen::VectorXd> way{q_home_, Away({0.4, -0.3}), Away({0.6, 0.1, 0.2})};
  const std::vector<Eigen::VectorXd> reversed(way.rbegin(), way.rend());
  const Motion there = MustRetime(JointCurve(way, 0.1), Limits{});
  const Motion back = MustRetime(JointCurve(reversed, 0.1), Limits{});
  EXPECT_LE(std::abs(there.steps() - back.steps()), 1);
}

TEST_F(RetimeTest, BeginsWithTheSpeedThatItIsGivenOrTheMostThatIsAllowed) {
  const JointCurve curve = Bent();
  const double from_rest = SecondsOf(MustRetime(curve, Limits{}));
  const Motion rolling = MustRetime(curve, Limits{}, 0.1);
  // stretched to whole control steps, by less than one of them
  EXPECT_NEAR(rolling.V_WE.front().head<3>().norm(), 0.1, 0.1 * kPeriod / SecondsOf(rolling) + 1e-9);
  EXPECT_LT(SecondsOf(rolling), from_rest);
  EXPECT_LE(MustRetime(curve, Limits{}, 5).V_WE.front().head<3>().norm(), Limits{}.linear * 1.001);
}

// what inverse kinematics leaves of the way to the goal is spread over the whole motion: no jump at its end
TEST_F(RetimeTest, WhatTheEndMissesOfTheGoalIsSpread) {
  const JointCurve curve = Bent();
  Pose goal = EndOf(curve);
  goal.p += Eigen::Vector3d(4e-4, -3e-4, 0);
  goal.q = (goal.q * FromEuler({0.001, 0, 0})).normalized();
  const auto motion = Retime(curve, kinematics_, Limits{}, 0, goal);
  ASSERT_TRUE(motion);
  const Motion exact = MustRetime(curve, Limits{});
  ASSERT_EQ(motion->steps(), exact.steps());
  EXPECT_EQ(motion->X_WE.back().p, goal.p);
  EXPECT_LT((motion->X_WE.front().p - exact.X_WE.front().p).norm(), 1e-9);
  double before = 0;
  for (int k = 0; k < exact.steps(); ++k) {
    const double off = (motion->X_WE[k].p - exact.X_WE[k].p).norm();
    EXPECT_LE(std::abs(off - before), 5e-5) << k;
    before = off;
  }
  EXPECT_NEAR(before, 5e-4, 1e-9);
}

TEST_F(RetimeTest, ThatWouldTakeMoreThanAMinuteIsNone) {
  Limits slow;
  slow.linear = 0.002;
  const JointCurve curve = Bent();
  EXPECT_FALSE(Retime(curve, kinematics_, slow, 0, EndOf(curve)));
}

TEST_F(RetimeTest, IsAFunctionOfItsArguments) {
  const Motion first = MustRetime(Bent(), Limits{}, 0.05);
  (void)MustRetime(JointCurve({q_home_, Away({0.2})}, 0.1), Loose());
  EXPECT_EQ(Bits(MustRetime(Bent(), Limits{}, 0.05)), Bits(first));
}

}  // namespace retime_test
}  // namespace etude::plan
