// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/lease_table.cc
#include "services/campaign/lease_table.h"

#include <gtest/gtest.h>

#include <map>
#include <optional>
#include <set>

#include "services/core/rng.h"

namespace etude::campaign {
namespace lease_table_test {

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

// Attempt k of index i fails by its nature: a pure function, as in a real campaign.
bool FailsByNature(std::uint64_t index, std::uint32_t attempt) { return MixSeed({index, attempt}, "fails") % 3 == 0; }

// Random workers that die, hang, fail, hand back and succeed, and an onlooker who knows every token ever granted.
class RandomCampaign {
 public:
  static constexpr std::uint64_t kTotal = 40;

  explicit RandomCampaign(int seed)
      : rng_(MixSeed({static_cast<std::uint64_t>(seed)}, "lease_table_test")),
        config_(DrawConfig(rng_)),
        table_(config_) {}

  // Some time goes by, and one worker does something; the invariants are checked.
  void Step() {
    now_ += std::chrono::milliseconds(rng_.Below(800));
    table_.Expire(now_);
    const std::string worker = "w" + std::to_string(rng_.Below(6));
    const auto held = working_.find(worker);
    const double draw = rng_.Uniform();
    if (held == working_.end()) {
      Ask(worker);
    } else if (draw < 0.1) {
      working_.erase(held);  // dies without a word
    } else if (draw < 0.5) {
      table_.Renew(held->second.index, held->second.token, now_);
    } else {
      const Assignment assignment = held->second;
      working_.erase(held);
      HandIn(assignment, draw < 0.55);
    }
    ASSERT_LE(table_.in_flight(), config_.max_in_flight);
  }
  bool complete() const { return table_.complete(); }

  void CheckEnd() const {
    EXPECT_EQ(committed_.size() + given_up_.size(), kTotal);
    EXPECT_EQ(table_.given_up(), given_up_.size());
    // the committed attempt is the first that does not fail, whatever the workers did
    for (const auto& [index, attempt] : committed_) {
      EXPECT_FALSE(FailsByNature(index, attempt));
      for (std::uint32_t earlier = 0; earlier < attempt; ++earlier) EXPECT_TRUE(FailsByNature(index, earlier));
    }
  }

 private:
  static LeaseTableConfig DrawConfig(Rng& rng) {
    auto config = Config(kTotal);
    config.max_in_flight = 1 + rng.Below(8);
    return config;
  }

  void Ask(const std::string& worker) {
    const Assignment assignment = table_.Request(worker, now_);
    if (assignment.kind != Assignment::Kind::kWork) return;
    if (granted_.insert(assignment.token).second) {
      ASSERT_GT(assignment.token, last_token_) << "tokens grow strictly";
      last_token_ = assignment.token;
    }
    ASSERT_FALSE(committed_.contains(assignment.index));
    newest_[assignment.index] = assignment.token;
    working_[worker] = assignment;
  }

  void HandIn(const Assignment& assignment, bool gives_back) {
    if (table_.Check(assignment.index, assignment.attempt, assignment.token) != LeaseValidity::kCurrent) return;
    ASSERT_EQ(newest_[assignment.index], assignment.token) << "only the newest token is current";
    ASSERT_FALSE(committed_.contains(assignment.index));
    if (gives_back) {
      table_.Release(assignment.index);
    } else if (FailsByNature(assignment.index, assignment.attempt)) {
      table_.Fail(assignment.index, LeaseTable::Retry::kNextAttempt);
      if (assignment.attempt + 1 == config_.max_attempts) given_up_.insert(assignment.index);
    } else {
      table_.Commit(assignment.index);
      committed_[assignment.index] = assignment.attempt;
    }
  }

  Rng rng_;
  LeaseTableConfig config_;
  LeaseTable table_;
  Time now_{};
  std::set<std::uint64_t> granted_;                // tokens
  std::map<std::uint64_t, std::uint64_t> newest_;  // index -> token
  std::uint64_t last_token_ = 0;
  std::map<std::string, Assignment> working_;
  std::map<std::uint64_t, std::uint32_t> committed_;
  std::set<std::uint64_t> given_up_;
};

class LeaseTableProperty : public testing::TestWithParam<int> {};

TEST_P(LeaseTableProperty, NothingLostNothingTwice) {
  RandomCampaign campaign(GetParam());
  for (int step = 0; step < 20'000 && !campaign.complete(); ++step) {
    campaign.Step();
    if (HasFatalFailure()) return;
  }
  ASSERT_TRUE(campaign.complete());
  campaign.CheckEnd();
}

INSTANTIATE_TEST_SUITE_P(Seeds, LeaseTableProperty, testing::Range(0, 50));

}  // namespace lease_table_test
}  // namespace etude::campaign
