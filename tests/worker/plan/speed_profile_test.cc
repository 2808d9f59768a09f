// SPDX-License-Identifier: Apache-2.0
// Tests worker/plan/speed_profile.cc
#include "worker/plan/speed_profile.h"

#include <gtest/gtest.h>

#include <cmath>

#include "services/core/rng.h"

namespace etude::plan::internal {
namespace {

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

}  // namespace
}  // namespace etude::plan::internal
