// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/geometry.cc
#include "worker/task/predicates/geometry.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "services/core/rng.h"

namespace etude::task {
namespace geometry_test {

constexpr double kHalfTurn = std::numbers::pi;

Eigen::Quaterniond About(const Eigen::Vector3d& axis, double angle) {
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis));
}

Eigen::Quaterniond AnyTurn(Rng& rng) {
  return Eigen::Quaterniond(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal()).normalized();
}

TEST(TiltOf, IsTheLeanWhicheverWayAnObjectFaces) {
  Rng rng(1);
  for (int i = 0; i < 200; ++i) {
    const double lean = rng.Uniform(0, kHalfTurn);
    const Eigen::Quaterniond q = About(Eigen::Vector3d::UnitZ(), rng.Uniform(-3, 3)) *
                                 About(Eigen::Vector3d::UnitX(), lean) *
                                 About(Eigen::Vector3d::UnitZ(), rng.Uniform(-3, 3));
    EXPECT_NEAR(TiltOf({{rng.Normal(), rng.Normal(), rng.Normal()}, q}), lean, 1e-6);
  }
}

// A simulation's quaternions are of length 1 but for rounding, and a cosine of -1.000004 has no angle.
TEST(TiltOf, OfAQuaternionThatIsALittleTooLongIsANumber) {
  Eigen::Quaterniond upside_down(0, 1, 0, 0);
  upside_down.coeffs() *= 1 + 1e-6;
  EXPECT_NEAR(TiltOf({{0, 0, 0}, upside_down}), kHalfTurn, 1e-9);
}

TEST(TurnError, IsZeroAfterTheTurnEitherWayFromAnyStart) {
  Rng rng(2);
  for (const double by : {0.4, kHalfTurn / 2, 2.5})
    for (int i = 0; i < 50; ++i) {
      const Pose start{{rng.Normal(), rng.Normal(), 0}, AnyTurn(rng)};
      for (const double sign : {1.0, -1.0}) {
        const Pose turned{{rng.Normal(), rng.Normal(), 0}, About(Eigen::Vector3d::UnitX(), sign * by) * start.q};
        EXPECT_NEAR(TurnError(turned, start, by), 0, 1e-6);
      }
      EXPECT_NEAR(TurnError(start, start, by), by, 1e-6) << "not turned at all";
    }
}

TEST(TurnError, IsWhatIsMissingAndWhatIsTooMuch) {
  Rng rng(3);
  const double quarter = kHalfTurn / 2;
  for (int i = 0; i < 50; ++i) {
    const Pose start{{0, 0, 0}, AnyTurn(rng)};
    const double turn = rng.Uniform(0.2, 1.4);
    const auto after = [&](const Eigen::Vector3d& axis, double angle) {
      return TurnError({{0, 0, 0}, About(axis, angle) * start.q}, start, quarter);
    };
    EXPECT_NEAR(after(Eigen::Vector3d::UnitX(), quarter - turn), turn, 1e-6);
    EXPECT_NEAR(after(Eigen::Vector3d::UnitX(), -quarter - turn), turn, 1e-6);
    // about another axis: the turn that is missing and the one that is too much, at right angles
    EXPECT_NEAR(after(Eigen::Vector3d::UnitZ(), turn), std::hypot(quarter, turn), 1e-6);
    EXPECT_NEAR(after(Eigen::Vector3d::UnitY(), turn), std::hypot(quarter, turn), 1e-6);
  }
}

TEST(HalfHeight, IsThatOfTheHighestCorner) {
  Rng rng(4);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d half(rng.Uniform(0.01, 0.2), rng.Uniform(0.01, 0.2), rng.Uniform(0.01, 0.2));
    const Eigen::Quaterniond q = AnyTurn(rng);
    double highest = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const Eigen::Vector3d signs(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
      highest = std::max(highest, (q * half.cwiseProduct(signs)).z());
    }
    EXPECT_NEAR(HalfHeight(half, q), highest, 1e-12);
  }
}

TEST(Sides, AreFourLevelDirectionsInOppositePairs) {
  ASSERT_EQ(Sides().size(), 4u);
  for (const auto& side : Sides()) {
    EXPECT_EQ(DirectionOfSide(side).norm(), 1) << side;
    EXPECT_EQ(DirectionOfSide(side).z(), 0) << side;
  }
  EXPECT_EQ(DirectionOfSide("left"), -DirectionOfSide("right"));
  EXPECT_EQ(DirectionOfSide("front"), -DirectionOfSide("behind"));
  EXPECT_EQ(DirectionOfSide("left").dot(DirectionOfSide("front")), 0);
}

TEST(SidesDeathTest, AnotherWordIsABug) { EXPECT_DEATH(DirectionOfSide("above"), "side=above"); }

TEST(IsOnSide, IsARectangleBesideTheOther) {
  Rng rng(5);
  const BesideBounds bounds{.near = 0.03, .far = 0.15, .aside = 0.06};
  int on_some = 0;
  for (int i = 0; i < 4000; ++i) {
    const Eigen::Vector3d p_WR(rng.Normal(), rng.Normal(), rng.Normal());
    const double dx = rng.Uniform(-0.2, 0.2), dy = rng.Uniform(-0.2, 0.2);
    const Eigen::Vector3d p_WO = p_WR + Eigen::Vector3d(dx, dy, rng.Normal());
    const auto within = [&](double along, double across) {
      return along > 0.03 && along < 0.15 && std::abs(across) < 0.06;
    };
    EXPECT_EQ(IsOnSide("left", p_WO, p_WR, bounds), within(dx, dy));
    EXPECT_EQ(IsOnSide("right", p_WO, p_WR, bounds), within(-dx, dy));
    EXPECT_EQ(IsOnSide("front", p_WO, p_WR, bounds), within(dy, dx));
    EXPECT_EQ(IsOnSide("behind", p_WO, p_WR, bounds), within(-dy, dx));
    on_some += within(dx, dy) || within(-dx, dy) || within(dy, dx) || within(-dy, dx);
  }
  EXPECT_GT(on_some, 1000);
  EXPECT_LT(on_some, 3000);
}

}  // namespace geometry_test
}  // namespace etude::task
