// SPDX-License-Identifier: Apache-2.0
// Tests services/core/statistics.cc
#include "services/core/statistics.h"

#include <gtest/gtest.h>

#include <cmath>

namespace etude {
namespace {

TEST(WilsonInterval, MatchesHandComputedValues) {
  // 8 of 10: centre (0.8 + 0.19207) / 1.38415 and half-width, z = 1.96
  EXPECT_NEAR(WilsonInterval(8, 10).low, 0.4902, 5e-4);
  EXPECT_NEAR(WilsonInterval(8, 10).high, 0.9433, 5e-4);
  EXPECT_NEAR(WilsonInterval(0, 10).high, 0.2775, 5e-4);
  EXPECT_DOUBLE_EQ(WilsonInterval(0, 10).low, 0);
  EXPECT_DOUBLE_EQ(WilsonInterval(0, 0).high, 1);
}

TEST(Quantile, InterpolatesLinearly) {
  EXPECT_DOUBLE_EQ(Quantile({3, 1, 2}, 0.5), 2);
  EXPECT_DOUBLE_EQ(Quantile({0, 10}, 0.95), 9.5);
  EXPECT_TRUE(std::isnan(Quantile({}, 0.5)));
  EXPECT_TRUE(std::isnan(Mean({})));
}

}  // namespace
}  // namespace etude
