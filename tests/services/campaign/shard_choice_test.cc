// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/shard_choice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace etude::campaign {
namespace shard_choice_test {

using namespace std::chrono_literals;

TEST(ShardChoice, GoesFromEachToTheNextAndFromTheLastToTheFirst) {
  ShardChoice choice("worker", 300s);
  choice.Joined(2);
  EXPECT_EQ(choice.Next({1, 2, 5}), 5u);
  choice.Joined(5);
  EXPECT_EQ(choice.Next({1, 2, 5}), 1u);
  EXPECT_EQ(choice.Next({5}), 5u) << "the only one that is open";
  EXPECT_EQ(choice.Next({}), std::nullopt);
}

TEST(ShardChoice, WorkersBeginWhereChanceSendsThemAndEachOneEverywhereInTheEnd) {
  std::map<std::uint32_t, int> begun;
  for (int k = 0; k < 300; ++k) ++begun[*ShardChoice("worker-" + std::to_string(k), 300s).Next({1, 2, 3})];
  ASSERT_EQ(begun.size(), 3u);
  for (const auto& [shard, workers] : begun) EXPECT_GT(workers, 60) << shard;

  std::map<std::uint32_t, int> visited;
  ShardChoice choice("worker", 300s);
  for (int k = 0; k < 60; ++k) {
    choice.GoAnywhere();
    const std::uint32_t next = *choice.Next({1, 2, 3});
    EXPECT_EQ(choice.Next({1, 2, 3}), next) << "until it has gone there";
    choice.Joined(next);
    ++visited[next];
  }
  EXPECT_EQ(visited.size(), 3u);
}

TEST(ShardChoice, WaitsLongerWhereNobodyHasWorkUpToABound) {
  ShardChoice choice("worker", 300s);
  std::vector<double> patience;
  for (int k = 0; k < 7; ++k) {
    double idle_s = 0;
    while (!choice.IsImpatient(idle_s)) ++idle_s;
    patience.push_back(idle_s);
    choice.WaitLonger();
  }
  EXPECT_EQ(patience, (std::vector<double>{2, 4, 8, 16, 32, 60, 60}));
  choice.FoundWork();
  EXPECT_TRUE(choice.IsImpatient(2));
}

TEST(ShardChoice, StaysForHalfToOneAndAHalfOfWhatItWasTold) {
  double least = 1000, most = 0;
  for (int k = 0; k < 100; ++k) {
    const ShardChoice choice("worker-" + std::to_string(k), 100s);
    double joined_s = 0;
    while (!choice.HasStayed(joined_s)) ++joined_s;
    least = std::min(least, joined_s);
    most = std::max(most, joined_s);
  }
  EXPECT_GE(least, 50);
  EXPECT_LT(least, 60);
  EXPECT_LE(most, 150);
  EXPECT_GT(most, 140) << "they do not all leave at once";
}

}  // namespace shard_choice_test
}  // namespace etude::campaign
