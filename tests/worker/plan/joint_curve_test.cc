// SPDX-License-Identifier: Apache-2.0
// Tests worker/plan/joint_curve.cc and worker/plan/shortcut.cc
#include "worker/plan/joint_curve.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "services/core/rng.h"
#include "worker/plan/shortcut.h"

namespace etude::plan::internal {
namespace joint_curve_test {

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

Eigen::VectorXd RandomPoint(int size, Rng& rng) {
  Eigen::VectorXd q(size);
  for (double& value : q) value = rng.Uniform(-2, 2);
  return q;
}

TEST(JointCurve, AlongAStraightLineItGoesEvenly) {
  Rng rng(5);
  for (const int size : {1, 3, 7}) {
    const Eigen::VectorXd from = RandomPoint(size, rng), to = RandomPoint(size, rng);
    // a line that is also said in three pieces
    for (const auto& line :
         {std::vector<Eigen::VectorXd>{from, to}, {from, from + 0.2 * (to - from), from + 0.9 * (to - from), to}}) {
      const JointCurve curve(line, 0.3);
      EXPECT_NEAR(curve.length(), (to - from).norm(), 1e-12);
      for (double u = 0; u <= 1; u += 0.0625) {
        const auto state = curve.At(u);
        EXPECT_LT((state.q - (from + u * (to - from))).norm(), 1e-12);
        EXPECT_LT((state.dq - (to - from)).norm(), 1e-9);
        EXPECT_LT(state.ddq.norm(), 1e-9);
      }
    }
  }
}

TEST(JointCurve, IsTwiceContinuousWhereItsPiecesMeet) {
  Rng rng(6);
  std::vector<Eigen::VectorXd> polyline;
  for (int i = 0; i < 5; ++i) polyline.push_back(RandomPoint(6, rng));
  const double spacing = 0.25;
  const JointCurve curve(polyline, spacing);
  const int spans = static_cast<int>(std::ceil(curve.length() / spacing));
  for (int knot = 1; knot < spans; ++knot) {
    const double u = static_cast<double>(knot) / spans;
    const auto before = curve.At(u - 1e-9), after = curve.At(u + 1e-9);
    EXPECT_LT((before.q - after.q).norm(), 1e-6);
    EXPECT_LT((before.dq - after.dq).norm(), 1e-4);
    EXPECT_LT((before.ddq - after.ddq).norm(), 1e-2);
  }
}

TEST(JointCurve, BeyondItsEndsItStaysThereAndTakesPointsThatStandTwice) {
  const Eigen::Vector2d a(0, 0), b(1, 0);
  const JointCurve curve({a, a, b, b}, 0.2);
  EXPECT_EQ(curve.length(), 1);
  EXPECT_LT((curve.At(-0.5).q - a).norm(), 1e-12);
  EXPECT_LT((curve.At(1.5).q - b).norm(), 1e-12);
  for (double u = 0; u <= 1; u += 0.1) EXPECT_TRUE(curve.At(u).ddq.allFinite());
}

/// Whether a straight way keeps off a disc around the origin.
bool KeepsOff(const Eigen::VectorXd& from, const Eigen::VectorXd& to, double radius) {
  return DistanceTo({from, to}, Eigen::Vector2d::Zero()) > radius;
}

TEST(Shortcut, NeverCutsThroughWhatIsInTheWay) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    // half a turn round the disc, at three times its radius
    std::vector<Eigen::VectorXd> path;
    for (int i = 0; i <= 24; ++i) path.push_back(3 * Eigen::Vector2d(std::cos(i * M_PI / 24), std::sin(i * M_PI / 24)));
    Rng rng(seed);
    int asked = 0;
    const auto shorter = Shortcut(path, 200, rng, [&](const auto& from, const auto& to) {
      ++asked;
      return KeepsOff(from, to, 1);
    });
    EXPECT_EQ(shorter.front(), path.front());
    EXPECT_EQ(shorter.back(), path.back());
    for (std::size_t i = 1; i < shorter.size(); ++i) EXPECT_TRUE(KeepsOff(shorter[i - 1], shorter[i], 1));
    // the shortest way is two tangents and an arc
    const double tangent = std::sqrt(8.0), arc = M_PI - 2 * std::acos(1.0 / 3);
    EXPECT_GE(Length(shorter), 2 * tangent + arc);
    EXPECT_LT(Length(shorter), 0.85 * Length(path));
    EXPECT_LE(asked, 200);
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

}  // namespace joint_curve_test
}  // namespace etude::plan::internal
