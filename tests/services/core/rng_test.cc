// SPDX-License-Identifier: Apache-2.0
// Tests services/core/rng.cc
#include "services/core/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <set>
#include <vector>

namespace etude {
namespace rng_test {

TEST(Rng, MatchesAnIndependentXoshiro) {
  // state {1, 2, 3, 4}: first outputs of the authors' reference, worked out by hand:
  // rotl(1 + 4, 23) + 1 = 41943041
  Rng rng(0);
  rng.set_state({1, 2, 3, 4});
  EXPECT_EQ(rng.Next(), 41943041u);
  EXPECT_EQ(rng.Next(), 58720359u);
  // and those that the Rust crate rand_xoshiro has of the authors' program
  for (const std::uint64_t next :
       {3588806011781223u, 3591011842654386u, 9228616714210784205u, 9973669472204895162u, 14011001112246962877u,
        12406186145184390807u, 15849039046786891736u, 10450023813501588000u})
    EXPECT_EQ(rng.Next(), next);
}

TEST(Rng, IsSeededBySplitMix64) {
  // the first outputs of Vigna's splitmix64.c for the seed 1234567
  const std::array<std::uint64_t, 4> expected{6457827717110365317u, 3203168211198807973u, 9817491932198370423u,
                                              4593380528125082431u};
  EXPECT_EQ(Rng(1234567).state(), expected);
}

TEST(Rng, SameSeedSameStreamAndResume) {
  Rng a(42), b(42);
  for (int i = 0; i < 10; ++i) EXPECT_EQ(a.Next(), b.Next());
  Rng c(0);
  c.set_state(a.state());
  EXPECT_EQ(a.Next(), c.Next());
}

TEST(Rng, BelowIsUniform) {
  Rng rng(1);
  std::array<int, 6> counts{};
  for (int i = 0; i < 60000; ++i) ++counts[rng.Below(6)];
  for (int count : counts) EXPECT_NEAR(count, 10000, 400);
  EXPECT_EQ(rng.Below(1), 0u);
}

TEST(Rng, BelowHasNoBiasWhereTheRangeDoesNotDivide) {
  // of 2^64 = 3 * 2^62 + 2^62 the remainder alone would make the first third twice as likely
  Rng rng(4);
  constexpr std::uint64_t third = std::uint64_t{1} << 62;
  std::array<int, 3> counts{};
  for (int i = 0; i < 30000; ++i) {
    const std::uint64_t draw = rng.Below(3 * third);
    ASSERT_LT(draw, 3 * third);
    ++counts[draw / third];
  }
  for (const int count : counts) EXPECT_NEAR(count, 10000, 400);
}

// The largest distance between the distribution of `draws` and a given one.
template <class Distribution>
double KolmogorovDistance(std::vector<double> draws, const Distribution& distribution) {
  std::sort(draws.begin(), draws.end());
  const double n = static_cast<double>(draws.size());
  double distance = 0;
  for (std::size_t i = 0; i < draws.size(); ++i) {
    const double expected = distribution(draws[i]);
    distance = std::max({distance, expected - i / n, (i + 1) / n - expected});
  }
  return distance;
}

TEST(Rng, UniformAndNormalHaveTheirDistributions) {
  Rng rng(6);
  std::vector<double> uniform(50000), between(50000), normal(50000);
  for (std::size_t i = 0; i < uniform.size(); ++i) {
    uniform[i] = rng.Uniform();
    between[i] = rng.Uniform(-3, 5);
    normal[i] = rng.Normal();
    ASSERT_TRUE(uniform[i] >= 0 && uniform[i] < 1);
    ASSERT_EQ(std::ldexp(uniform[i], 53), std::floor(std::ldexp(uniform[i], 53))) << "53 bits";
  }
  // beyond 1.95 / sqrt(n) once in a thousand seeds
  EXPECT_LT(KolmogorovDistance(uniform, [](double x) { return x; }), 0.0087);
  EXPECT_LT(KolmogorovDistance(between, [](double x) { return (x + 3) / 8; }), 0.0087);
  EXPECT_LT(KolmogorovDistance(normal, [](double x) { return std::erfc(-x / std::sqrt(2.0)) / 2; }), 0.0087);
}

TEST(Rng, EveryOrderIsAsLikely) {
  Rng rng(7);
  std::map<std::vector<int>, int> orders;
  for (int i = 0; i < 24000; ++i) {
    std::vector<int> items{0, 1, 2, 3};
    rng.Shuffle(items);
    ++orders[items];
  }
  ASSERT_EQ(orders.size(), 24u);
  for (const auto& [order, count] : orders) EXPECT_NEAR(count, 1000, 130);
}

TEST(Rng, BernoulliIsNeverAlwaysOrItsShare) {
  Rng rng(8);
  int some = 0;
  for (int i = 0; i < 20000; ++i) {
    ASSERT_FALSE(rng.Bernoulli(0));
    ASSERT_TRUE(rng.Bernoulli(1));
    some += rng.Bernoulli(0.3);
  }
  EXPECT_NEAR(some, 6000, 250);
}

TEST(Rng, NormalHasUnitMoments) {
  Rng rng(2);
  double sum = 0, squares = 0;
  constexpr int n = 100000;
  for (int i = 0; i < n; ++i) {
    const double x = rng.Normal();
    sum += x;
    squares += x * x;
  }
  EXPECT_NEAR(sum / n, 0, 0.02);
  EXPECT_NEAR(squares / n, 1, 0.03);
}

TEST(MixSeed, SeparatesNumbersOrderAndPurpose) {
  std::set<std::uint64_t> seeds;
  for (std::uint64_t i = 0; i < 100; ++i)
    for (std::uint64_t j = 0; j < 100; ++j) seeds.insert(MixSeed({i, j}, "scene"));
  EXPECT_EQ(seeds.size(), 10000u);
  EXPECT_NE(MixSeed({1, 2}, "scene"), MixSeed({2, 1}, "scene"));
  EXPECT_NE(MixSeed({1, 2}, "scene"), MixSeed({1, 2}, "plan"));
}

TEST(MixSeed, OneBitOfANumberChangesHalfOfTheSeed) {
  double flipped = 0;
  for (int bit = 0; bit < 64; ++bit) {
    const int count = std::popcount(MixSeed({12, 0}) ^ MixSeed({12, std::uint64_t{1} << bit}));
    EXPECT_GT(count, 12) << bit;
    EXPECT_LT(count, 52) << bit;
    flipped += count;
  }
  EXPECT_NEAR(flipped / 64, 32, 2);
}

}  // namespace rng_test
}  // namespace etude
