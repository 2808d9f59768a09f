// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/lease_table.cc
#include "services/campaign/lease_table.h"

#include <gtest/gtest.h>

#include <map>
#include <optional>
#include <set>

#include "services/core/rng.h"

namespace etude::campaign {
namespace {

using namespace std::chrono_literals;
using Time = LeaseTable::Time;

LeaseTableConfig Config(std::uint64_t total) {
  LeaseTableConfig config;
  config.total = total;
  config.max_attempts = 3;
  config.duration = 10s;
  return config;
}

TEST(LeaseTable, LeasesLowestIndicesFirst) {
  LeaseTable table(Config(3));
  for (std::uint64_t i = 0; i < 3; ++i) {
    const Assignment assignment = table.Request("w" + std::to_string(i), Time{});
    EXPECT_EQ(assignment.kind, Assignment::Kind::kWork);
    EXPECT_EQ(assignment.index, i);
  }
  EXPECT_EQ(table.Request("w3", Time{}).kind, Assignment::Kind::kWait);
}

TEST(LeaseTable, TheFrontierLiesBehindEverythingThatWasEverTouched) {
  LeaseTable table(Config(9));
  EXPECT_EQ(table.frontier(), 0u);
  table.RestoreCommitted(3);
  table.RestoreCommitted(99);
  EXPECT_EQ(table.frontier(), 4u) << "what lies behind the end does not count";
  table.RestoreFailures(5, 1, 1);
  EXPECT_EQ(table.frontier(), 6u);
  for (std::uint64_t i = 0; i < 3; ++i) EXPECT_EQ(table.Request("w" + std::to_string(i), Time{}).index, i);
  EXPECT_EQ(table.frontier(), 6u);
  table.Revoke("w1");
  EXPECT_EQ(table.Request("x", Time{}).index, 4u);
  EXPECT_EQ(table.Request("y", Time{}).index, 5u);
  EXPECT_EQ(table.Request("z", Time{}).index, 6u);
  EXPECT_EQ(table.frontier(), 7u);
}

TEST(LeaseTable, AnswersARepeatedRequestWithTheSameLease) {
  LeaseTable table(Config(3));
  const Assignment first = table.Request("w", Time{});
  const Assignment again = table.Request("w", Time{} + 9s);
  EXPECT_EQ(again.token, first.token);
  EXPECT_EQ(table.Expire(Time{} + 11s), 0) << "the request renews";
}

TEST(LeaseTable, ExpiredLeaseIsLeasedAgainWithALargerToken) {
  LeaseTable table(Config(1));
  const Assignment old = table.Request("dead", Time{});
  EXPECT_EQ(table.Expire(Time{} + 9s), 0);
  EXPECT_EQ(table.Expire(Time{} + 10s), 1);
  const Assignment assignment = table.Request("alive", Time{} + 10s);
  EXPECT_EQ(assignment.index, old.index);
  EXPECT_EQ(assignment.attempt, old.attempt);
  EXPECT_GT(assignment.token, old.token);
  EXPECT_EQ(table.Check(0, 0, old.token), LeaseValidity::kStale);
  EXPECT_EQ(table.Check(0, 0, assignment.token), LeaseValidity::kCurrent);
}

TEST(LeaseTable, ExpiredTokenStaysTheNewestUntilLeasedAgain) {
  LeaseTable table(Config(1));
  const Assignment assignment = table.Request("slow", Time{});
  table.Expire(Time{} + 1h);
  EXPECT_EQ(table.Check(0, 0, assignment.token), LeaseValidity::kCurrent);
  table.Commit(0);
  EXPECT_TRUE(table.complete());
  EXPECT_EQ(table.Request("other", Time{} + 1h).kind, Assignment::Kind::kDone);
}

TEST(LeaseTable, HeartbeatsKeepALease) {
  LeaseTable table(Config(1));
  const Assignment assignment = table.Request("w", Time{});
  for (int s = 5; s <= 100; s += 5) {
    EXPECT_TRUE(table.Renew(assignment.index, assignment.token, Time{} + std::chrono::seconds(s)));
    EXPECT_EQ(table.Expire(Time{} + std::chrono::seconds(s)), 0);
  }
  EXPECT_FALSE(table.Renew(assignment.index, assignment.token + 1, Time{}));
}

TEST(LeaseTable, FailuresLeadToTheNextAttemptAndThenToGivingUp) {
  LeaseTable table(Config(1));
  for (std::uint32_t attempt = 0; attempt < 3; ++attempt) {
    const Assignment assignment = table.Request("w", Time{});
    ASSERT_EQ(assignment.kind, Assignment::Kind::kWork);
    EXPECT_EQ(assignment.attempt, attempt);
    table.Fail(0, LeaseTable::Retry::kNextAttempt);
    EXPECT_EQ(table.Check(0, attempt, assignment.token), LeaseValidity::kStale);
  }
  EXPECT_EQ(table.given_up(), 1u);
  EXPECT_EQ(table.Request("w", Time{}).kind, Assignment::Kind::kDone);
}

TEST(LeaseTable, WhatCanNeverSucceedIsClosedAtOnce) {
  LeaseTable table(Config(2));
  const Assignment grant = table.Request("w", Time{});
  table.Fail(grant.index, LeaseTable::Retry::kNever);
  EXPECT_EQ(table.given_up(), 1u);
  EXPECT_EQ(table.Request("w", Time{}).index, 1u);
  EXPECT_EQ(table.Check(0, 0, grant.token), LeaseValidity::kStale);
}

TEST(LeaseTable, HandingBackCountsNothing) {
  LeaseTable table(Config(1));
  for (int i = 0; i < 10; ++i) {
    const Assignment assignment = table.Request("w", Time{});
    EXPECT_EQ(assignment.attempt, 0u);
    table.Release(0);
    EXPECT_EQ(table.Check(0, 0, assignment.token), LeaseValidity::kStale);
  }
  EXPECT_EQ(table.given_up(), 0u);
}

TEST(LeaseTable, AnIndexThatKillsItsWorkersYieldsToOthers) {
  LeaseTable table(Config(2));
  ASSERT_EQ(table.Request("a", Time{}).index, 0u);
  table.Revoke("a");
  EXPECT_EQ(table.Request("b", Time{}).index, 1u);
  EXPECT_EQ(table.Request("c", Time{}).index, 0u);
  EXPECT_EQ(table.lost(), 1u);
}

TEST(LeaseTable, BoundsWhatIsInFlight) {
  auto config = Config(100);
  config.max_in_flight = 2;
  LeaseTable table(config);
  table.Request("a", Time{});
  table.Request("b", Time{});
  EXPECT_EQ(table.Request("c", Time{}).kind, Assignment::Kind::kWait);
  table.Commit(0);
  EXPECT_EQ(table.Request("c", Time{}).kind, Assignment::Kind::kWork);
}

TEST(LeaseTable, ResumesFromWhatIsDurable) {
  auto config = Config(4);
  config.epoch = 7;
  LeaseTable table(config);
  table.RestoreCommitted(0);
  table.RestoreFailures(1, 2, 2);
  table.RestoreFailures(2, 3, 3);
  table.RestoreCommitted(99);  // of a longer campaign
  const Assignment assignment = table.Request("w", Time{});
  EXPECT_EQ(assignment.index, 1u);
  EXPECT_EQ(assignment.attempt, 2u);
  EXPECT_EQ(assignment.token >> 32, 7u);
  EXPECT_EQ(table.Request("v", Time{}).index, 3u);
  EXPECT_EQ(table.given_up(), 1u);
  EXPECT_EQ(table.Check(0, 0, 1), LeaseValidity::kCommitted);
}

// What an onlooker knows: every token ever granted and which index it was for.
struct Onlooker {
  std::map<std::uint64_t, Assignment> grants;     // token -> assignment
  std::map<std::uint64_t, std::uint64_t> newest;  // index -> token
  std::uint64_t last_token = 0;
};

// Random workers that die, hang, fail, hand back and succeed; whatever happens, the invariants hold.
class LeaseTableProperty : public testing::TestWithParam<int> {};

TEST_P(LeaseTableProperty, NothingLostNothingTwice) {
  Rng rng(MixSeed({static_cast<std::uint64_t>(GetParam())}, "lease_table_test"));
  constexpr std::uint64_t kTotal = 40;
  auto config = Config(kTotal);
  config.max_in_flight = 1 + rng.Below(8);
  LeaseTable table(config);
  // attempt k of index i fails by its nature: a pure function, as in a real campaign
  const auto fails = [](std::uint64_t index, std::uint32_t attempt) {
    return MixSeed({index, attempt}, "fails") % 3 == 0;
  };
  Onlooker onlooker;
  std::map<std::string, Assignment> working;
  std::map<std::uint64_t, std::uint32_t> committed;
  std::set<std::uint64_t> given_up;
  Time now{};
  for (int step = 0; step < 20'000 && !table.complete(); ++step) {
    now += std::chrono::milliseconds(rng.Below(800));
    table.Expire(now);
    const std::string worker = "w" + std::to_string(rng.Below(6));
    auto held = working.find(worker);
    const double draw = rng.Uniform();
    if (held == working.end()) {
      const Assignment assignment = table.Request(worker, now);
      if (assignment.kind != Assignment::Kind::kWork) continue;
      if (!onlooker.grants.contains(assignment.token)) {
        ASSERT_GT(assignment.token, onlooker.last_token) << "tokens grow strictly";
        onlooker.last_token = assignment.token;
      }
      ASSERT_FALSE(committed.contains(assignment.index));
      onlooker.grants[assignment.token] = assignment;
      onlooker.newest[assignment.index] = assignment.token;
      working[worker] = assignment;
    } else if (draw < 0.1) {
      working.erase(held);  // dies without a word
    } else if (draw < 0.5) {
      table.Renew(held->second.index, held->second.token, now);
    } else {
      const Assignment assignment = held->second;
      working.erase(held);
      const LeaseValidity standing = table.Check(assignment.index, assignment.attempt, assignment.token);
      if (standing == LeaseValidity::kCurrent) {
        ASSERT_EQ(onlooker.newest[assignment.index], assignment.token) << "only the newest token is current";
        ASSERT_FALSE(committed.contains(assignment.index));
        if (draw < 0.55) {
          table.Release(assignment.index);
        } else if (fails(assignment.index, assignment.attempt)) {
          table.Fail(assignment.index, LeaseTable::Retry::kNextAttempt);
          if (assignment.attempt + 1 == config.max_attempts) given_up.insert(assignment.index);
        } else {
          table.Commit(assignment.index);
          committed[assignment.index] = assignment.attempt;
        }
      }
    }
    ASSERT_LE(table.in_flight(), config.max_in_flight);
  }
  ASSERT_TRUE(table.complete());
  EXPECT_EQ(committed.size() + given_up.size(), kTotal);
  EXPECT_EQ(table.given_up(), given_up.size());
  // the committed attempt is the first that does not fail, whatever the workers did
  for (const auto& [index, attempt] : committed) {
    EXPECT_FALSE(fails(index, attempt));
    for (std::uint32_t earlier = 0; earlier < attempt; ++earlier) EXPECT_TRUE(fails(index, earlier));
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, LeaseTableProperty, testing::Range(0, 50));

}  // namespace
}  // namespace etude::campaign
