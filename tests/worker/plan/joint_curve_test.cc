// SPDX-License-Identifier: Apache-2.0
// Tests worker/plan/joint_curve.cc and worker/plan/shortcut.cc
#include "worker/plan/joint_curve.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "worker/plan/shortcut.h"

namespace etude::plan::internal {
namespace {

std::vector<Eigen::VectorXd> Corner() { return {Eigen::Vector2d(0, 0), Eigen::Vector2d(1, 0), Eigen::Vector2d(1, 1)}; }

double DistanceTo(const std::vector<Eigen::VectorXd>& polyline, const Eigen::VectorXd& q) {
  double least = 1e9;
  for (std::size_t i = 1; i < polyline.size(); ++i) {
    const Eigen::VectorXd side = polyline[i] - polyline[i - 1];
    const double part = std::clamp(side.dot(q - polyline[i - 1]) / side.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (polyline[i - 1] + side * part - q).norm());
  }
  return least;
}

TEST(JointCurve, EndsOnThePolylineAndStaysNearIt) {
  for (const double spacing : {0.4, 0.1, 0.02}) {
    const JointCurve curve(Corner(), spacing);
    EXPECT_LT((curve.At(0).q - Corner().front()).norm(), 1e-12);
    EXPECT_LT((curve.At(1).q - Corner().back()).norm(), 1e-12);
    double farthest = 0;
    for (int i = 0; i <= 1000; ++i) farthest = std::max(farthest, DistanceTo(Corner(), curve.At(i / 1000.0).q));
    EXPECT_LT(farthest, spacing);
    EXPECT_GT(farthest, spacing / 20);
  }
}

TEST(JointCurve, DerivativesAgreeWithFiniteDifferences) {
  const JointCurve curve(Corner(), 0.15);
  constexpr double kStep = 1e-5;
  for (int i = 1; i < 200; ++i) {
    const double u = i / 200.0 + 1e-4;
    const auto before = curve.At(u - kStep), now = curve.At(u), after = curve.At(u + kStep);
    EXPECT_LT(((after.q - before.q) / (2 * kStep) - now.dq).norm(), 1e-6);
    EXPECT_LT(((after.dq - before.dq) / (2 * kStep) - now.ddq).norm(), 0.02);
  }
}

TEST(Shortcut, ShortensWhereFreeAndKeepsTheEnds) {
  Rng rng(2);
  const std::vector<Eigen::VectorXd> path = Corner();
  const auto shorter = Shortcut(path, 50, rng, [](const auto&, const auto&) { return true; });
  EXPECT_EQ(shorter.front(), path.front());
  EXPECT_EQ(shorter.back(), path.back());
  EXPECT_LT(Length(shorter), 1.6);

  Rng again(2);
  const auto same = Shortcut(path, 50, again, [](const auto&, const auto&) { return false; });
  EXPECT_EQ(same, path);
}

}  // namespace
}  // namespace etude::plan::internal
