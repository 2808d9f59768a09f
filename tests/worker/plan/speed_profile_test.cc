// SPDX-License-Identifier: Apache-2.0
// Tests worker/plan/speed_profile.cc
#include "worker/plan/speed_profile.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "services/core/rng.h"

namespace etude::plan::internal {
namespace speed_profile_test {

constexpr double kPeriod = 0.008;

TEST(SpeedProfile, KeepsItsLimitsAndEndsForRandomCases) {
  Rng rng(1);
  for (int i = 0; i < 2000; ++i) {
    const double length = std::pow(10, rng.Uniform(-4, 1)), max_speed = std::pow(10, rng.Uniform(-2, 1));
    const double accel = std::pow(10, rng.Uniform(-1, 1.5));
    const double start = rng.Bernoulli(0.3) ? 0 : rng.Uniform(0, 2 * max_speed);
    const double kept = std::min(start, 2 * std::sqrt(accel * length));
    const SpeedProfile profile(length, start, max_speed, accel, kPeriod);

    EXPECT_EQ(profile.At(0).s, 0);
    EXPECT_NEAR(profile.At(0).ds, kept, 1e-12);
    EXPECT_EQ(profile.At(profile.steps()).s, length);
    EXPECT_EQ(profile.At(profile.steps()).ds, 0);
    const bool brakes_hard = kept * kept / (2 * accel) >= length;
    for (int step = 1; step <= profile.steps(); ++step) {
      const auto before = profile.At(step - 1), now = profile.At(step);
      // the parameter moves by the mean of the rates, up to a kink in between
      const double change = std::abs(now.ds - before.ds);
      EXPECT_NEAR(now.s - before.s, kPeriod * (now.ds + before.ds) / 2,
                  kPeriod * (change + accel * kPeriod) / 2 + 1e-12);
      EXPECT_LE(now.ds, std::max(max_speed, kept) * (1 + 1e-9));
      if (profile.steps() > 2 && !brakes_hard) {
        EXPECT_GE(now.s, before.s - 1e-12);
        EXPECT_LE(change, accel * kPeriod * (1 + 1e-6) + 1e-12);
      }
    }
  }
}

TEST(SpeedProfile, TakesTheShortestTimeUpToOnePeriod) {
  // 0.3 m at 0.3 m/s and 1.5 m/s^2: 1 s at speed, 0.2 s for the two ramps
  EXPECT_EQ(SpeedProfile(0.3, 0, 0.3, 1.5, kPeriod).steps(), 150);
  // too short to reach the speed: 2 sqrt(l / a) = 0.163 s
  EXPECT_EQ(SpeedProfile(0.01, 0, 0.3, 1.5, kPeriod).steps(), 21);
}

// From rest to rest: a trapezoid takes l / v + v / a, a triangle 2 sqrt(l / a), rounded up to whole periods.
TEST(SpeedProfile, TakesTheTimeOfTheTextbooks) {
  Rng rng(3);
  int triangles = 0;
  for (int i = 0; i < 1000; ++i) {
    const double l = std::pow(10, rng.Uniform(-3, 1)), v = std::pow(10, rng.Uniform(-2, 1)), a = rng.Uniform(0.5, 20);
    const bool is_triangle = v * v / a >= l;
    triangles += is_triangle;
    const double shortest = is_triangle ? 2 * std::sqrt(l / a) : l / v + v / a;
    const SpeedProfile profile(l, 0, v, a, kPeriod);
    EXPECT_EQ(profile.steps(), std::max(1, static_cast<int>(std::ceil(shortest / kPeriod - 1e-9)))) << l << " " << v;
  }
  EXPECT_GT(triangles, 200);
  EXPECT_LT(triangles, 800);
}

TEST(SpeedProfile, GoesTheSameWayThereAndBack) {
  Rng rng(4);
  for (int i = 0; i < 200; ++i) {
    const double length = rng.Uniform(0.01, 1);
    const SpeedProfile profile(length, 0, rng.Uniform(0.05, 1), rng.Uniform(0.5, 5), kPeriod);
    for (int step = 0; step <= profile.steps(); ++step) {
      const auto there = profile.At(step), back = profile.At(profile.steps() - step);
      ASSERT_NEAR(there.s, length - back.s, 1e-9);
      ASSERT_NEAR(there.ds, back.ds, 1e-9);
    }
  }
}

TEST(SpeedProfile, AStartThatIsTooFastToStopIsLoweredAndBrakes) {
  const double length = 0.01, accel = 1;
  const SpeedProfile profile(length, 5, 1, accel, kPeriod);
  EXPECT_NEAR(profile.At(0).ds, 2 * std::sqrt(accel * length), 1e-12) << "what stops at twice the acceleration";
  for (int step = 1; step <= profile.steps(); ++step) {
    EXPECT_LE(profile.At(step).ds, profile.At(step - 1).ds + 1e-12) << "only ever slower";
    EXPECT_GE(profile.At(step).s, profile.At(step - 1).s);
  }
}

TEST(WholePeriods, AreNeverShorterAndAtLeastOne) {
  EXPECT_EQ(WholePeriods(0, 0.008), 1);
  EXPECT_EQ(WholePeriods(0.008, 0.008), 1);
  EXPECT_EQ(WholePeriods(0.0081, 0.008), 2);
  EXPECT_EQ(WholePeriods(3 * 0.1, 0.1), 3) << "rounding of 0.3 adds no period";
}

}  // namespace speed_profile_test
}  // namespace etude::plan::internal
