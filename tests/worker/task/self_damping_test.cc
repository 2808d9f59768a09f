// SPDX-License-Identifier: Apache-2.0
#include "worker/task/self_damping.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <string>

#include "services/core/rng.h"
#include "tests/worker/sim/scene_fixture.h"

namespace etude::task {
namespace self_damping_test {

using Eigen::VectorXd;

// one bound: v_0 >= -0.1
VelocityDampers OneOfSix() { return {Eigen::MatrixXd(Eigen::RowVectorXd::Unit(6, 0)), VectorXd::Constant(1, -0.1)}; }

TEST(Damped, LeavesWhatIsAllowed) {
  VectorXd v = VectorXd::LinSpaced(6, -0.05, 1);
  EXPECT_EQ(Damped(v, OneOfSix()), v);
  EXPECT_EQ(Damped(v, {}), v);
}

TEST(Damped, TakesOutWhatComesTooNearAndNothingElse) {
  VectorXd v = VectorXd::Constant(6, -1);
  VectorXd expected = v;
  expected[0] = -0.1;
  EXPECT_LT((Damped(v, OneOfSix()) - expected).norm(), 1e-12);
}

// the nearest point of the intersection of half-spaces, by trying which of the bounds are reached
VectorXd Reference(const VectorXd& v, const VelocityDampers& dampers) {
  const auto rows = static_cast<int>(dampers.least.size());
  std::optional<VectorXd> best;
  for (int reached = 0; reached < 1 << rows; ++reached) {
    std::vector<int> which;
    for (int i = 0; i < rows; ++i)
      if (reached >> i & 1) which.push_back(i);
    VectorXd x = v;
    if (!which.empty()) {
      const Eigen::MatrixXd A = dampers.slopes(which, Eigen::all);
      x += A.transpose() * (A * A.transpose()).ldlt().solve(dampers.least(which) - A * v);
    }
    if ((dampers.slopes * x - dampers.least).minCoeff() < -1e-9) continue;
    if (!best || (x - v).norm() < (*best - v).norm()) best = x;
  }
  return *best;
}

TEST(Damped, IsTheNearestThatSeveralAllow) {
  Rng rng(3);
  const auto draw = [&] { return rng.Uniform(-1, 1); };
  int changed = 0;
  for (int i = 0; i < 200; ++i) {
    VelocityDampers dampers{Eigen::MatrixXd::NullaryExpr(3, 6, draw), -0.3 * VectorXd::NullaryExpr(3, draw).cwiseAbs()};
    const VectorXd v = VectorXd::NullaryExpr(6, draw);
    const VectorXd expected = Reference(v, dampers), damped = Damped(v, dampers);
    changed += (expected - v).norm() > 0;
    EXPECT_LT((damped - expected).norm(), 0.01) << i;
  }
  EXPECT_GT(changed, 100);
}

TEST(SelfDampers, AreTheSlopesOfTheDistances) {
  const auto scene = sim::SceneOf("ur5");
  collide::Checker checker(scene);
  sim::Kinematics kinematics(scene);
  const auto distances = [&](const VectorXd& q) { return checker.Distances(q, 0.07, collide::PairSet::kSelfApart); };
  Rng rng(5);
  int compared = 0;
  for (int i = 0; i < 400 && compared < 20; ++i) {
    VectorXd q = scene->arm().q_home;
    for (double& angle : q) angle += rng.Uniform(-1.2, 1.2);
    const VelocityDampers dampers = SelfDampers(checker, kinematics, q, 0);
    if (dampers.empty()) continue;
    const VectorXd v = VectorXd::NullaryExpr(6, [&] { return rng.Uniform(-1, 1); });
    constexpr double kSmall = 1e-4;  // s
    Eigen::Index row = 0;
    for (const auto& pair : checker.Distances(q, 0.06, collide::PairSet::kSelfApart)) {
      const auto after = distances(q + kSmall * v);
      const auto same = std::ranges::find_if(
          after, [&](const auto& p) { return p.body_a == pair.body_a && p.body_b == pair.body_b; });
      ASSERT_NE(same, after.end());
      EXPECT_LE(dampers.least[row], 0);
      if (pair.distance > 0.005) {
        EXPECT_NEAR(dampers.least[row], -8 * (pair.distance - 0.005), 1e-9);
        // FCL's distances are right to 1e-5 m
        EXPECT_NEAR((same->distance - pair.distance) / kSmall, dampers.slopes.row(row).dot(v), 0.12)
            << pair.body_a << " " << pair.body_b;
        ++compared;
      }
      ++row;
    }
  }
  EXPECT_GE(compared, 20);
}

// Two neighbours that are never far from each other are nobody's fault; what plans keep apart is.
TEST(SelfDampers, HoldNothingAtHome) {
  for (const std::string robot : {"ur5", "panda", "jaco2"}) {
    const auto scene = sim::SceneOf(robot);
    collide::Checker checker(scene);
    sim::Kinematics kinematics(scene);
    checker.SetGripper(0.25);
    const VelocityDampers dampers = SelfDampers(checker, kinematics, scene->arm().q_home, 1);
    EXPECT_TRUE(dampers.empty() || dampers.least.maxCoeff() < 0) << robot << ": two bodies are held where they are";
    EXPECT_EQ(checker.gripper(), 0.25) << "others ask it, too";
  }
}

}  // namespace self_damping_test
}  // namespace etude::task
