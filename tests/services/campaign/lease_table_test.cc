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
    const Grant grant = table.Request("w" + std::to_string(i), Time{});
    EXPECT_EQ(grant.kind, Grant::Kind::kWork);
    EXPECT_EQ(grant.index, i);
  }
  EXPECT_EQ(table.Request("w3", Time{}).kind, Grant::Kind::kWait);
}

TEST(LeaseTable, AnswersARepeatedRequestWithTheSameLease) {
  LeaseTable table(Config(3));
  const Grant first = table.Request("w", Time{});
  const Grant again = table.Request("w", Time{} + 9s);
  EXPECT_EQ(again.token, first.token);
  EXPECT_EQ(table.Expire(Time{} + 11s), 0) << "the request renews";
}

TEST(LeaseTable, ExpiredLeaseIsLeasedAgainWithALargerToken) {
  LeaseTable table(Config(1));
  const Grant old = table.Request("dead", Time{});
  EXPECT_EQ(table.Expire(Time{} + 9s), 0);
  EXPECT_EQ(table.Expire(Time{} + 10s), 1);
  const Grant grant = table.Request("alive", Time{} + 10s);
  EXPECT_EQ(grant.index, old.index);
  EXPECT_EQ(grant.attempt, old.attempt);
  EXPECT_GT(grant.token, old.token);
  EXPECT_EQ(table.Check(0, 0, old.token), Standing::kStale);
  EXPECT_EQ(table.Check(0, 0, grant.token), Standing::kCurrent);
}

TEST(LeaseTable, ExpiredTokenStaysTheNewestUntilLeasedAgain) {
  LeaseTable table(Config(1));
  const Grant grant = table.Request("slow", Time{});
  table.Expire(Time{} + 1h);
  EXPECT_EQ(table.Check(0, 0, grant.token), Standing::kCurrent);
  table.Commit(0);
  EXPECT_TRUE(table.complete());
  EXPECT_EQ(table.Request("other", Time{} + 1h).kind, Grant::Kind::kDone);
}

TEST(LeaseTable, HeartbeatsKeepALease) {
  LeaseTable table(Config(1));
  const Grant grant = table.Request("w", Time{});
  for (int s = 5; s <= 100; s += 5) {
    EXPECT_TRUE(table.Renew(grant.index, grant.token, Time{} + std::chrono::seconds(s)));
    EXPECT_EQ(table.Expire(Time{} + std::chrono::seconds(s)), 0);
  }
  EXPECT_FALSE(table.Renew(grant.index, grant.token + 1, Time{}));
}

TEST(LeaseTable, FailuresLeadToTheNextAttemptAndThenToGivingUp) {
  LeaseTable table(Config(1));
  for (std::uint32_t attempt = 0; attempt < 3; ++attempt) {
    const Grant grant = table.Request("w", Time{});
    ASSERT_EQ(grant.kind, Grant::Kind::kWork);
    EXPECT_EQ(grant.attempt, attempt);
    table.Fail(0, LeaseTable::Retry::kNextAttempt);
    EXPECT_EQ(table.Check(0, attempt, grant.token), Standing::kStale);
  }
  EXPECT_EQ(table.given_up(), 1u);
  EXPECT_EQ(table.Request("w", Time{}).kind, Grant::Kind::kDone);
}

TEST(LeaseTable, HandingBackCountsNothing) {
  LeaseTable table(Config(1));
  for (int i = 0; i < 10; ++i) {
    const Grant grant = table.Request("w", Time{});
    EXPECT_EQ(grant.attempt, 0u);
    table.HandBack(0);
    EXPECT_EQ(table.Check(0, 0, grant.token), Standing::kStale);
  }
  EXPECT_EQ(table.given_up(), 0u);
}

TEST(LeaseTable, AnIndexThatKillsItsWorkersYieldsToOthers) {
  LeaseTable table(Config(2));
  ASSERT_EQ(table.Request("a", Time{}).index, 0u);
  table.ForgetWorker("a");
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
  EXPECT_EQ(table.Request("c", Time{}).kind, Grant::Kind::kWait);
  table.Commit(0);
  EXPECT_EQ(table.Request("c", Time{}).kind, Grant::Kind::kWork);
}

TEST(LeaseTable, ResumesFromWhatIsDurable) {
  auto config = Config(4);
  config.epoch = 7;
  LeaseTable table(config);
  table.RestoreCommitted(0);
  table.RestoreFailures(1, 2, 2);
  table.RestoreFailures(2, 3, 3);
  table.RestoreCommitted(99);  // of a longer campaign
  const Grant grant = table.Request("w", Time{});
  EXPECT_EQ(grant.index, 1u);
  EXPECT_EQ(grant.attempt, 2u);
  EXPECT_EQ(grant.token >> 32, 7u);
  EXPECT_EQ(table.Request("v", Time{}).index, 3u);
  EXPECT_EQ(table.given_up(), 1u);
  EXPECT_EQ(table.Check(0, 0, 1), Standing::kCommitted);
}

// What an onlooker knows: every token ever granted and which index it was for.
struct Onlooker {
  std::map<std::uint64_t, Grant> grants;          // token -> grant
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
  std::map<std::string, Grant> working;
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
      const Grant grant = table.Request(worker, now);
      if (grant.kind != Grant::Kind::kWork) continue;
      if (!onlooker.grants.contains(grant.token)) {
        ASSERT_GT(grant.token, onlooker.last_token) << "tokens grow strictly";
        onlooker.last_token = grant.token;
      }
      ASSERT_FALSE(committed.contains(grant.index));
      onlooker.grants[grant.token] = grant;
      onlooker.newest[grant.index] = grant.token;
      working[worker] = grant;
    } else if (draw < 0.1) {
      working.erase(held);  // dies without a word
    } else if (draw < 0.5) {
      table.Renew(held->second.index, held->second.token, now);
    } else {
      const Grant grant = held->second;
      working.erase(held);
      const Standing standing = table.Check(grant.index, grant.attempt, grant.token);
      if (standing == Standing::kCurrent) {
        ASSERT_EQ(onlooker.newest[grant.index], grant.token) << "only the newest token is current";
        ASSERT_FALSE(committed.contains(grant.index));
        if (draw < 0.55) {
          table.HandBack(grant.index);
        } else if (fails(grant.index, grant.attempt)) {
          table.Fail(grant.index, LeaseTable::Retry::kNextAttempt);
          if (grant.attempt + 1 == config.max_attempts) given_up.insert(grant.index);
        } else {
          table.Commit(grant.index);
          committed[grant.index] = grant.attempt;
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
