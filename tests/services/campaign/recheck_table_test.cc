// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/recheck_table.cc
#include "services/campaign/recheck_table.h"

#include <gtest/gtest.h>

#include <set>
#include <string>

namespace etude::campaign {
namespace recheck_table_test {

using namespace std::chrono_literals;
using Time = RecheckTable::Time;

constexpr Time kStart{1000s};

RecheckTable All() { return RecheckTable({.share = 1, .seed = 7, .epoch = 3, .duration = 10s}); }

CommittedEpisode Made(std::uint64_t index, const std::string& host) {
  return {index, 2, "worker-of-" + host, host, "sha-" + std::to_string(index)};
}

TEST(RecheckTable, ChoosesTheStatedShareByIndexAndSeedAlone) {
  const RecheckTable some({.share = 0.02, .seed = 7}), same({.share = 0.02, .seed = 7, .epoch = 9}),
      other({.share = 0.02, .seed = 8}), none({.share = 0, .seed = 7});
  int chosen = 0, elsewhere = 0;
  for (std::uint64_t index = 0; index < 100'000; ++index) {
    EXPECT_EQ(some.Chosen(index), same.Chosen(index));
    EXPECT_FALSE(none.Chosen(index));
    EXPECT_TRUE(All().Chosen(index));
    chosen += some.Chosen(index);
    elsewhere += some.Chosen(index) && other.Chosen(index);
  }
  EXPECT_NEAR(chosen, 2000, 200);
  EXPECT_LT(elsewhere, 100) << "another seed, other episodes";
}

TEST(RecheckTable, OnlyAWorkerOfAnotherHostGetsTheSameAttempt) {
  RecheckTable table = All();
  table.Add(Made(5, "lab-1"), kStart);
  table.Add(Made(4, "lab-1"), kStart);
  table.Add(Made(9, ""), kStart);  // nobody knows whose it is
  EXPECT_EQ(table.waiting(), 2u);
  EXPECT_FALSE(table.Request("b", "lab-1", kStart));
  EXPECT_FALSE(table.Request("c", "", kStart));
  EXPECT_FALSE(table.WaitsFor("lab-1"));
  EXPECT_FALSE(table.WaitsFor(""));
  EXPECT_TRUE(table.WaitsFor("lab-2"));
  const auto lease = table.Request("d", "lab-2", kStart);
  ASSERT_TRUE(lease);
  EXPECT_EQ(lease->kind, Assignment::Kind::kWork);
  EXPECT_EQ(lease->index, 4u);
  EXPECT_EQ(lease->attempt, 2u);
  EXPECT_EQ(EpochOf(lease->token), 3u);
  EXPECT_EQ(table.Request("d", "lab-2", kStart)->token, lease->token) << "asked again";

  EXPECT_FALSE(table.Take(lease->token, "e", kStart)) << "not its lease";
  const auto taken = table.Take(lease->token, "d", kStart);
  ASSERT_TRUE(taken);
  EXPECT_EQ(taken->episode.sha256, "sha-4");
  EXPECT_EQ(taken->episode.host, "lab-1");
  EXPECT_EQ(taken->host, "lab-2");
  EXPECT_FALSE(table.Take(lease->token, "d", kStart)) << "once";
  EXPECT_EQ(table.Request("d", "lab-2", kStart)->index, 5u);
}

TEST(RecheckTable, WhatIsLostOrGivenBackGoesToAnotherAndIsLeftAfterSomeTries) {
  RecheckTable table = All();
  table.Add(Made(1, "lab-1"), kStart);
  const auto first = table.Request("b", "lab-2", kStart);
  ASSERT_TRUE(first);
  EXPECT_FALSE(table.Renew(first->token, "b", kStart + 9s)) << "its mark is what is said";
  EXPECT_FALSE(table.Renew(MarkOf(first->token), "c", kStart + 9s)) << "not its lease";
  EXPECT_TRUE(table.Renew(MarkOf(first->token), "b", kStart + 8s));
  std::vector<std::string> silent;
  table.Expire(kStart + 17s, &silent);
  EXPECT_TRUE(silent.empty()) << "renewed";
  table.Expire(kStart + 18s, &silent);
  EXPECT_EQ(silent, std::vector<std::string>{"b"});
  EXPECT_FALSE(table.Renew(MarkOf(first->token), "b", kStart + 18s));
  EXPECT_FALSE(table.Take(first->token, "b", kStart + 18s)) << "too late";

  const auto second = table.Request("c", "lab-2", kStart + 18s);
  ASSERT_TRUE(second);
  EXPECT_NE(second->token, first->token);
  EXPECT_FALSE(table.Release(second->token, "b"));
  EXPECT_TRUE(table.Release(second->token, "c"));
  ASSERT_TRUE(table.Request("d", "lab-2", kStart + 18s));
  table.Revoke("d");
  EXPECT_EQ(table.in_flight() + table.waiting(), 0u) << "left unchecked";
}

TEST(RecheckTable, AtTheEndOnlyAHostThatIsThereIsWaitedForAndNotForEver) {
  RecheckTable table = All();
  EXPECT_FALSE(table.Awaits({"lab-1", "lab-2"}, kStart)) << "nothing to be made again";
  table.Add(Made(1, "lab-1"), kStart);
  EXPECT_FALSE(table.Awaits({}, kStart));
  EXPECT_FALSE(table.Awaits({"lab-1"}, kStart));
  EXPECT_TRUE(table.Awaits({"lab-1", "lab-2"}, kStart));
  EXPECT_TRUE(table.Awaits({"lab-2"}, kStart));
  EXPECT_FALSE(table.Awaits({"lab-2"}, kStart + RecheckTable::kPatience)) << "it never asks";
  ASSERT_TRUE(table.Request("b", "lab-2", kStart + 90s));
  EXPECT_TRUE(table.Awaits({}, kStart + 200s)) << "on its way until its lease ends";
  table.Expire(kStart + 200s, nullptr);
  EXPECT_FALSE(table.Awaits({"lab-1"}, kStart + 200s));
}

}  // namespace recheck_table_test
}  // namespace etude::campaign
