// SPDX-License-Identifier: Apache-2.0
// Tests services/core/statistics.cc
#include "services/core/statistics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "services/core/rng.h"

namespace etude {
namespace statistics_test {

TEST(WilsonInterval, MatchesHandComputedValues) {
  // 8 of 10: centre (0.8 + 0.19207) / 1.38415 and half-width, z = 1.96
  EXPECT_NEAR(WilsonInterval(8, 10).low, 0.4902, 5e-4);
  EXPECT_NEAR(WilsonInterval(8, 10).high, 0.9433, 5e-4);
  EXPECT_NEAR(WilsonInterval(0, 10).high, 0.2775, 5e-4);
  EXPECT_DOUBLE_EQ(WilsonInterval(0, 10).low, 0);
  EXPECT_DOUBLE_EQ(WilsonInterval(0, 0).high, 1);
}

// Wilson's bounds are the proportions p of which the observed share is just z standard deviations away.
TEST(WilsonInterval, EndsWhereTheScoreTestDoes) {
  constexpr double z2 = 3.841458820694124;  // 95 % quantile of chi square with one degree of freedom
  for (std::uint64_t n = 1; n <= 60; ++n)
    for (std::uint64_t k = 0; k <= n; ++k) {
      const Interval interval = WilsonInterval(k, n);
      const double share = static_cast<double>(k) / static_cast<double>(n);
      for (const double p : {interval.low, interval.high})
        EXPECT_NEAR((share - p) * (share - p) * static_cast<double>(n), z2 * p * (1 - p), 1e-9) << k << " of " << n;
      EXPECT_LE(interval.low, share + 1e-12);
      EXPECT_GE(interval.high, share - 1e-12);
      EXPECT_NEAR(interval.low, 1 - WilsonInterval(n - k, n).high, 1e-12) << "failures mirror successes";
    }
}

TEST(McNemarExactP, IsTheClosedFormWhereThereIsOne) {
  EXPECT_EQ(McNemarExactP(0, 0), 1);
  for (std::uint64_t n = 1; n <= 60; ++n) {
    const double all = std::ldexp(1.0, -static_cast<int>(n));  // of one outcome of n coins
    EXPECT_DOUBLE_EQ(McNemarExactP(0, n), std::min(1.0, 2 * all)) << n;
    if (n > 3) {
      EXPECT_DOUBLE_EQ(McNemarExactP(n - 1, 1), 2 * (1 + static_cast<double>(n)) * all) << n;
    }
    EXPECT_EQ(McNemarExactP(n, n), 1) << "an even split is no evidence";
    // an odd number of coins: one half of all outcomes has fewer of one side
    EXPECT_NEAR(McNemarExactP(n, n - 1), 1, 1e-12) << n;
  }
  EXPECT_DOUBLE_EQ(McNemarExactP(0, 1000), std::ldexp(2.0, -1000));
}

// Reference: the formulas of the paper, evaluated independently.
TEST(NewcombePairedInterval, MatchesTheFormulasOfThePaper) {
  struct Case {
    std::uint64_t both, first, second, neither;
    double low, high;
  };
  for (const auto& [both, first, second, neither, low, high] :
       {Case{391, 4, 2, 3, -0.0101109, 0.0215505}, Case{36, 12, 2, 0, 0.0569296, 0.3404276},
        Case{20, 12, 2, 16, 0.0561564, 0.3292070}, Case{53, 2, 0, 0, -0.0340324, 0.1232346},
        Case{54, 0, 0, 0, -0.0664136, 0.0664136}, Case{0, 54, 0, 0, 0.9060770, 1}}) {
    const Interval interval = NewcombePairedInterval(both, first, second, neither);
    EXPECT_NEAR(interval.low, low, 1e-6) << both << " " << first << " " << second << " " << neither;
    EXPECT_NEAR(interval.high, high, 1e-6) << both << " " << first << " " << second << " " << neither;
    const Interval mirrored = NewcombePairedInterval(both, second, first, neither);
    EXPECT_NEAR(mirrored.low, -interval.high, 1e-12) << "the other way round";
  }
  EXPECT_EQ(NewcombePairedInterval(0, 0, 0, 0).low, -1);
}

TEST(McNemarExactP, IsTheSumOfTheBinomial) {
  for (std::uint64_t n = 1; n <= 40; ++n)
    for (std::uint64_t k = 0; k <= n; ++k) {
      // row n of Pascal's triangle, by additions only
      std::vector<double> row{1};
      for (std::uint64_t i = 0; i < n; ++i) {
        row.push_back(0);
        for (std::size_t j = row.size() - 1; j > 0; --j) row[j] += row[j - 1];
      }
      double tail = 0;
      for (std::uint64_t i = 0; i <= std::min(k, n - k); ++i) tail += row[i];
      EXPECT_NEAR(McNemarExactP(k, n - k), std::min(1.0, 2 * std::ldexp(tail, -static_cast<int>(n))), 1e-14);
      EXPECT_EQ(McNemarExactP(k, n - k), McNemarExactP(n - k, k));
    }
}

TEST(McNemarExactP, HoldsWhereABinomialIsBeyondADouble) {
  // 2000 coins: C(2000, 900) is near 10^598. The normal approximation with correction for continuity, to 1 %
  const double z = (2000.0 / 2 - 950 - 0.5) / std::sqrt(2000.0 / 4);
  EXPECT_NEAR(McNemarExactP(950, 1050) / std::erfc(z / std::sqrt(2.0)), 1, 0.01);
  EXPECT_GT(McNemarExactP(900, 1100), 0);
  EXPECT_LT(McNemarExactP(900, 1100), 1e-5);
  EXPECT_EQ(McNemarExactP(0, 100'000), 0) << "smaller than any double";
  EXPECT_NEAR(McNemarExactP(50'000, 50'001), 1, 1e-9);
}

TEST(Quantile, IsThatOfTheSortedValues) {
  Rng rng(9);
  for (int round = 0; round < 200; ++round) {
    std::vector<double> values(1 + rng.Below(20));
    for (double& value : values) value = static_cast<double>(rng.Below(8));  // with values that stand twice
    std::vector<double> sorted = values;
    std::sort(sorted.begin(), sorted.end());
    for (const double q : {0.0, 0.25, rng.Uniform(), 1.0}) {
      const double place = q * static_cast<double>(sorted.size() - 1);
      const auto below = static_cast<std::size_t>(place);
      const std::size_t above = std::min(below + 1, sorted.size() - 1);
      const double expected = sorted[below] + (place - static_cast<double>(below)) * (sorted[above] - sorted[below]);
      ASSERT_NEAR(Quantile(values, q), expected, 1e-12) << q;
    }
  }
}

TEST(Mean, IsTheSumByTheCount) { EXPECT_DOUBLE_EQ(Mean({1, 2, 6}), 3); }

TEST(Quantile, InterpolatesLinearly) {
  EXPECT_DOUBLE_EQ(Quantile({3, 1, 2}, 0.5), 2);
  EXPECT_DOUBLE_EQ(Quantile({0, 10}, 0.95), 9.5);
  EXPECT_TRUE(std::isnan(Quantile({}, 0.5)));
  EXPECT_TRUE(std::isnan(Mean({})));
}

}  // namespace statistics_test
}  // namespace etude
