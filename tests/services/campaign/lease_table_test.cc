// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/lease_table.cc
#include "services/campaign/lease_table.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

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
  EXPECT_EQ(table.frontier(), 4u);
  table.RestoreFailures(5, 1, 1);
  EXPECT_EQ(table.frontier(), 6u);
  for (std::uint64_t i = 0; i < 3; ++i) EXPECT_EQ(table.Request("w" + std::to_string(i), Time{}).index, i);
  EXPECT_EQ(table.frontier(), 6u);
  table.Revoke("w1");
  EXPECT_EQ(table.Request("x", Time{}).index, 4u);
  EXPECT_EQ(table.Request("y", Time{}).index, 5u);
  EXPECT_EQ(table.Request("z", Time{}).index, 6u);
  EXPECT_EQ(table.frontier(), 7u);
  table.RestoreCommitted(99);
  EXPECT_EQ(table.frontier(), 100u) << "made before the campaign was shortened, with the weights that held then";
  table.RestoreFailures(120, 1, 1);
  EXPECT_EQ(table.frontier(), 121u) << "and tried with them";
}

TEST(LeaseTable, AShardLeasesItsOwnIndicesAndNoOthers) {
  LeaseTableConfig config = Config(11);
  config.shard = {2, 3};  // 1, 4, 7, 10
  LeaseTable table(config);
  EXPECT_EQ(table.size(), 4u);
  table.RestoreCommitted(0);  // of another shard
  table.RestoreFailures(2, 3, 3);
  table.RestoreCommitted(4);
  EXPECT_EQ(table.committed(), 1u);
  EXPECT_EQ(table.given_up(), 0u);
  for (const std::uint64_t index : {1, 7, 10}) {
    const Assignment assignment = table.Request("w" + std::to_string(index), Time{});
    ASSERT_EQ(assignment.kind, Assignment::Kind::kWork);
    EXPECT_EQ(assignment.index, index);
    EXPECT_EQ(table.Check(index + 1, 0, assignment.token), LeaseValidity::kStale) << "not leased here";
  }
  EXPECT_EQ(table.Request("late", Time{}).kind, Assignment::Kind::kWait);
  for (const std::uint64_t index : {1, 7}) table.Commit(index);
  for (int attempt = 0; attempt < 3; ++attempt) {
    (void)table.Request("w10", Time{});
    table.Fail(10, Retry::kNextAttempt);
  }
  EXPECT_EQ(table.given_up(), 1u);
  EXPECT_TRUE(table.complete());
  EXPECT_EQ(table.Request("late", Time{}).kind, Assignment::Kind::kDone);
}

TEST(LeaseTable, AShardOfACampaignWithFewerEpisodesIsComplete) {
  LeaseTableConfig config = Config(2);
  config.shard = {3, 3};
  LeaseTable table(config);
  EXPECT_EQ(table.size(), 0u);
  EXPECT_EQ(table.Request("w", Time{}).kind, Assignment::Kind::kDone);
}

TEST(LeaseTable, AnswersARepeatedRequestWithTheSameLease) {
  LeaseTable table(Config(3));
  const Assignment first = table.Request("w", Time{});
  const Assignment again = table.Request("w", Time{} + 9s);
  EXPECT_EQ(again.token, first.token);
  EXPECT_EQ(table.Expire(Time{} + 11s), 0) << "the request renews";
}

TEST(LeaseTable, ExpiredLeaseIsLeasedAgainWithAnotherToken) {
  LeaseTable table(Config(1));
  const Assignment old = table.Request("dead", Time{});
  EXPECT_EQ(table.Expire(Time{} + 9s), 0);
  EXPECT_EQ(table.Expire(Time{} + 10s), 1);
  const Assignment assignment = table.Request("alive", Time{} + 10s);
  EXPECT_EQ(assignment.index, old.index);
  EXPECT_EQ(assignment.attempt, old.attempt);
  EXPECT_NE(assignment.token, old.token);
  EXPECT_EQ(table.Check(0, 0, old.token), LeaseValidity::kStale);
  EXPECT_EQ(table.Check(0, 0, assignment.token), LeaseValidity::kCurrent);
}

TEST(LeaseTable, WhileNobodyCouldBeHeardNothingExpires) {
  LeaseTable table(Config(2));
  ASSERT_EQ(table.Request("a", Time{}).kind, Assignment::Kind::kWork);
  table.Postpone(1h);
  EXPECT_EQ(table.Expire(Time{} + 1h + 9s), 0);
  EXPECT_EQ(table.Expire(Time{} + 1h + 10s), 1);
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
    EXPECT_TRUE(table.Renew(assignment.index, MarkOf(assignment.token), Time{} + std::chrono::seconds(s)));
    EXPECT_EQ(table.Expire(Time{} + std::chrono::seconds(s)), 0);
  }
  EXPECT_FALSE(table.Renew(assignment.index, MarkOf(assignment.token + 1), Time{}));
}

TEST(LeaseTable, FailuresLeadToTheNextAttemptAndThenToGivingUp) {
  LeaseTable table(Config(1));
  for (std::uint32_t attempt = 0; attempt < 3; ++attempt) {
    const Assignment assignment = table.Request("w", Time{});
    ASSERT_EQ(assignment.kind, Assignment::Kind::kWork);
    EXPECT_EQ(assignment.attempt, attempt);
    table.Fail(0, Retry::kNextAttempt);
    EXPECT_EQ(table.Check(0, attempt, assignment.token), LeaseValidity::kStale);
  }
  EXPECT_EQ(table.given_up(), 1u);
  EXPECT_EQ(table.Request("w", Time{}).kind, Assignment::Kind::kDone);
}

TEST(LeaseTable, WhatCanNeverSucceedIsClosedAtOnce) {
  LeaseTable table(Config(2));
  const Assignment grant = table.Request("w", Time{});
  table.Fail(grant.index, Retry::kNever);
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
  EXPECT_EQ(EpochOf(assignment.token), 7u);
  EXPECT_EQ(table.Request("v", Time{}).index, 3u);
  EXPECT_EQ(table.given_up(), 1u);
  EXPECT_EQ(table.Check(0, 0, 1), LeaseValidity::kCommitted);
}

TEST(LeaseTable, AWorkerThatIsAtItMayHoldOneMore) {
  LeaseTable table(Config(9));
  const Assignment first = table.Request("w", Time{});
  const Assignment next = table.Request("w", Time{}, MarkOf(first.token));
  ASSERT_EQ(next.kind, Assignment::Kind::kWork);
  EXPECT_EQ(next.index, 1u);
  EXPECT_EQ(table.Request("w", Time{}, MarkOf(first.token)).token, next.token) << "an answer that was lost";
  EXPECT_EQ(table.in_flight(), 2u);
  EXPECT_EQ(table.Request("w", Time{}).token, first.token) << "what it began comes first";
  EXPECT_TRUE(table.Holds("w", MarkOf(first.token)));
  table.Commit(first.index);
  EXPECT_FALSE(table.Holds("w", MarkOf(next.token)));
  EXPECT_EQ(table.Request("w", Time{}).token, next.token);
  EXPECT_EQ(table.Request("w", Time{}, MarkOf(next.token)).index, 2u);
  EXPECT_EQ(table.Request("invented", Time{}, 12345).kind, Assignment::Kind::kWait)
      << "no heartbeat would renew what waits behind a lease that is not of this table";
  EXPECT_EQ(table.Request("invented", Time{}).index, 3u);
}

TEST(LeaseTable, WhoWasCutOffForLongerThanALeaseGoesOnWithIt) {
  LeaseTable table(Config(9));
  const Assignment first = table.Request("w", Time{});
  const Assignment next = table.Request("w", Time{}, MarkOf(first.token));
  EXPECT_EQ(table.Expire(Time{} + 1h), 1);
  EXPECT_TRUE(table.Renew(first.index, MarkOf(first.token), Time{} + 1h));
  EXPECT_EQ(table.Request("other", Time{} + 1h).index, next.index) << "what waited went to who came first";
  EXPECT_FALSE(table.Renew(next.index, MarkOf(next.token), Time{} + 1h)) << "and is theirs";
  EXPECT_EQ(table.Request("third", Time{} + 1h).index, 2u) << "nobody else is leased what it goes on with";
  EXPECT_EQ(table.in_flight(), 3u);
  EXPECT_EQ(table.Expire(Time{} + 1h + 9s), 0);
  table.Commit(first.index);
  EXPECT_FALSE(table.Renew(first.index, MarkOf(first.token), Time{} + 1h)) << "it is closed";
}

TEST(LeaseTable, WhatWasTakenFromAWorkerDoesNotComeBackByItsHeartbeats) {
  LeaseTable table(Config(9));
  const Assignment taken = table.Request("still", Time{});
  table.Revoke("still");
  EXPECT_FALSE(table.Renew(taken.index, MarkOf(taken.token), Time{}));
  EXPECT_EQ(table.in_flight(), 0u);
  EXPECT_EQ(table.Check(taken.index, 0, taken.token), LeaseValidity::kCurrent) << "its result would count";
}

TEST(LeaseTable, WhatWaitsLivesAsLongAsWhatIsWorkedOn) {
  LeaseTable table(Config(9));
  const Assignment first = table.Request("w", Time{});
  const Assignment next = table.Request("w", Time{}, MarkOf(first.token));
  for (int s = 5; s <= 100; s += 5) {
    EXPECT_TRUE(table.Renew(first.index, MarkOf(first.token), Time{} + std::chrono::seconds(s)));
    EXPECT_EQ(table.Expire(Time{} + std::chrono::seconds(s)), 0);
  }
  EXPECT_EQ(table.Check(next.index, 0, next.token), LeaseValidity::kCurrent);
  std::vector<std::string> holders;
  EXPECT_EQ(table.Expire(Time{} + 1h, &holders), 1) << "what waited was nobody's work";
  EXPECT_EQ(holders, std::vector<std::string>{"w"});
  EXPECT_EQ(table.in_flight(), 0u);
  EXPECT_EQ(table.lost(), 1u);
}

TEST(LeaseTable, WhatWaitedForADeadWorkerIsFreeAndCountsNothing) {
  LeaseTable table(Config(9));
  const Assignment first = table.Request("dead", Time{});
  const Assignment next = table.Request("dead", Time{}, MarkOf(first.token));
  table.Revoke("dead");
  EXPECT_EQ(table.lost(), 1u);
  EXPECT_EQ(table.Request("a", Time{}).index, next.index) << "before those that nobody was leased";
  for (std::uint64_t index = 2; index < 9; ++index)
    EXPECT_EQ(table.Request("w" + std::to_string(index), Time{}).index, index);
  EXPECT_EQ(table.Request("last", Time{}).index, first.index) << "what lost its worker comes behind";
}

TEST(LeaseTable, WhereAnotherAttemptWouldBeTheSameTheIndexIsGivenUp) {
  auto config = Config(1);
  config.max_deaths = 2;
  config.one_attempt = true;
  LeaseTable told(config), seen(config);
  EXPECT_FALSE(told.CountDeath(told.Request("w", Time{}).index));
  EXPECT_TRUE(told.CountDeath(told.Request("w", Time{}).index));
  EXPECT_EQ(told.given_up(), 1u);
  for (int death = 1; death <= 2; ++death) {
    (void)seen.Request("w", Time{});
    EXPECT_EQ(seen.Revoke("w", true).has_value(), death == 2);
  }
  EXPECT_EQ(seen.given_up(), 1u);
}

// An attempt is a function of its numbers: what crashed three workers would crash the next one, too.
TEST(LeaseTable, AnAttemptThatEndsWorkersHasFailedItself) {
  auto config = Config(2);
  config.max_deaths = 3;
  LeaseTable table(config);
  const Assignment other = table.Request("other", Time{});
  std::uint64_t index = 0;
  for (int death = 1; death <= 3; ++death) {
    const Assignment deadly = table.Request("w", Time{});
    EXPECT_EQ(deadly.attempt, 0u);
    index = deadly.index;
    if (death == 2) {  // a host says so; the others are seen to be dead
      EXPECT_FALSE(table.CountDeath(index));
    } else {
      const auto failed = table.Revoke("w", true);
      ASSERT_EQ(failed.has_value(), death == 3);
      EXPECT_EQ(failed ? failed->index : index, index);
    }
  }
  EXPECT_EQ(table.lost(), 2u) << "of the third a host had told";
  const Assignment next = table.Request("w", Time{});
  EXPECT_EQ(next.index, index);
  EXPECT_EQ(next.attempt, 1u);
  for (int k = 0; k < 9; ++k) {  // killed from outside: nothing is counted against it
    table.Revoke("w");
    EXPECT_EQ(table.Request("w", Time{}).attempt, 1u);
  }
  EXPECT_EQ(table.Check(other.index, 0, other.token), LeaseValidity::kCurrent);
}

// The collector saw that it did not move, and its host saw that too.
TEST(LeaseTable, AWorkerThatIsLostTwiceDiesOnce) {
  LeaseTable table(Config(1));
  for (int death = 1; death <= 2; ++death) {
    const Assignment deadly = table.Request("w", Time{});
    EXPECT_FALSE(table.Revoke("w", true));
    EXPECT_FALSE(table.CountDeath(deadly.index)) << "death " << death;
  }
  table.Request("w", Time{});
  EXPECT_TRUE(table.Revoke("w", true));
}

TEST(LeaseTable, OfSeveralThatEndWorkersOneComesToItsEndAfterTheOther) {
  LeaseTable table(Config(3));
  int deaths = 0;
  while (!table.CountDeath(table.Request("w", Time{}).index)) ++deaths;
  EXPECT_EQ(deaths, 4) << "each once, and then the first again and again";
}

TEST(LeaseTable, WhatWasBegunIsLostLikeAnyOther) {
  LeaseTable table(Config(9));
  const Assignment first = table.Request("w", Time{});
  const Assignment next = table.Request("w", Time{}, MarkOf(first.token));
  table.Commit(first.index);
  EXPECT_TRUE(table.Renew(next.index, MarkOf(next.token), Time{}));
  table.Revoke("w");
  EXPECT_EQ(table.lost(), 1u);
  EXPECT_EQ(table.Request("other", Time{}).index, 2u);
}

TEST(LeaseTable, NothingIsLeasedAheadThatSomebodyElseMayBeFreeFor) {
  LeaseTable table(Config(4));
  const Assignment a = table.Request("a", Time{}), b = table.Request("b", Time{});
  EXPECT_EQ(table.Request("a", Time{}, MarkOf(a.token)).index, 2u) << "two are left, and two work";
  EXPECT_EQ(table.Request("b", Time{}, MarkOf(b.token)).kind, Assignment::Kind::kWait);
  EXPECT_EQ(table.Request("c", Time{}).index, 3u);
}

TEST(LeaseTable, BoundsWhatIsLeasedAhead) {
  auto config = Config(100);
  config.max_in_flight = 2;
  LeaseTable table(config);
  const Assignment a = table.Request("a", Time{});
  EXPECT_EQ(table.Request("a", Time{}, MarkOf(a.token)).kind, Assignment::Kind::kWork);
  const Assignment b = table.Request("b", Time{});
  ASSERT_EQ(b.kind, Assignment::Kind::kWork) << "what waits takes nobody's place";
  EXPECT_EQ(table.Request("b", Time{}, MarkOf(b.token)).kind, Assignment::Kind::kWork);
  EXPECT_EQ(table.Request("c", Time{}).kind, Assignment::Kind::kWait);
  EXPECT_EQ(table.in_flight(), 4u);
}

TEST(LeaseTable, TokensAreNotToBeGuessedFromOthers) {
  constexpr std::uint64_t kLeases = 1000;
  LeaseTable table(Config(kLeases));
  std::set<std::uint64_t> tokens;
  std::uint64_t ones = 0, zeros = 0;  // bits that were one, or zero, in any
  for (std::uint64_t i = 0; i < kLeases; ++i) {
    const std::uint64_t token = table.Request("w" + std::to_string(i), Time{}).token;
    tokens.insert(token);
    ones |= token;
    zeros |= ~token;
  }
  EXPECT_EQ(tokens.size(), kLeases);
  constexpr std::uint64_t kRandom = (1ull << kTokenRandomBits) - 1;
  EXPECT_EQ(ones & zeros & kRandom, kRandom) << "each of the bits is drawn";
  std::uint64_t smallest = ~0ull;
  for (auto next = std::next(tokens.begin()); next != tokens.end(); ++next)
    smallest = std::min(smallest, *next - *std::prev(next));
  // of a thousand in 2^40 the closest two are about 2^20 apart
  EXPECT_GT(smallest, 1u);
  int guessed = 0;
  for (const std::uint64_t token : tokens)
    for (std::uint64_t step = 1; step <= 10; ++step) guessed += table.IndexOf(token + step).has_value();
  EXPECT_EQ(guessed, 0);
}

// What others may hear is as good as a token nowhere.
TEST(LeaseTable, AMarkRenewsAndIsNoToken) {
  LeaseTable table(Config(2));
  const Assignment lease = table.Request("w", Time{});
  const std::uint64_t mark = MarkOf(lease.token);
  EXPECT_EQ(MarkOf(0), 0u);
  EXPECT_NE(mark, lease.token);
  EXPECT_NE(mark, MarkOf(lease.token + 1));
  EXPECT_TRUE(table.Renew(lease.index, mark, Time{}));
  EXPECT_FALSE(table.Renew(lease.index, lease.token, Time{}));
  EXPECT_FALSE(table.IndexOf(mark));
  EXPECT_EQ(table.Check(lease.index, lease.attempt, mark), LeaseValidity::kStale);
  table.Release(lease.index);
  EXPECT_FALSE(table.Renew(lease.index, mark, Time{}));
  EXPECT_FALSE(table.Renew(lease.index, 0, Time{})) << "of no lease";
}

TEST(LeaseTable, TwoIndicesNeverHaveOneToken) {
  auto config = Config(3);
  std::uint64_t draws = 0;
  config.random = [&draws] { return 5 + draws++ / 3; };  // the same one three times
  LeaseTable table(config);
  const Assignment first = table.Request("a", Time{}), second = table.Request("b", Time{});
  EXPECT_EQ(first.token, (1ull << kTokenRandomBits) + 5);
  EXPECT_EQ(second.token, (1ull << kTokenRandomBits) + 6);
  EXPECT_EQ(table.IndexOf(first.token), 0u);
  EXPECT_EQ(table.IndexOf(second.token), 1u);
  table.Commit(0);
  EXPECT_FALSE(table.IndexOf(first.token));
  EXPECT_FALSE(table.IndexOf(0));
}

TEST(LeaseTable, ALeaseIsItsWorkersAlone) {
  LeaseTable table(Config(2));
  ASSERT_EQ(table.Request("slow", Time{}).index, 0u);
  EXPECT_TRUE(table.WentTo(0, "slow"));
  EXPECT_FALSE(table.WentTo(0, "thief"));
  EXPECT_FALSE(table.WentTo(1, "slow"));
  EXPECT_FALSE(table.WentTo(99, "slow"));
  table.Expire(Time{} + 1h);
  EXPECT_TRUE(table.WentTo(0, "slow")) << "a late report is still its own";
  ASSERT_EQ(table.Request("other", Time{} + 1h).index, 1u);
  ASSERT_EQ(table.Request("next", Time{} + 1h).index, 0u);
  EXPECT_FALSE(table.WentTo(0, "slow"));
  table.Release(0);
  EXPECT_FALSE(table.WentTo(0, "next"));
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
    } else if (draw < 0.02) {
      LookAhead(worker, held->second);
    } else if (draw < 0.1) {
      working_.erase(held);  // dies without a word
    } else if (draw < 0.5) {
      table_.Renew(held->second.index, MarkOf(held->second.token), now_);
    } else {
      const Assignment assignment = held->second;
      working_.erase(held);
      HandIn(assignment, draw < 0.55);
    }
    ASSERT_LE(table_.in_flight(), 2 * config_.max_in_flight);
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
    const bool is_new = granted_.insert(assignment.token).second;
    ASSERT_TRUE(is_new || newest_[assignment.index] == assignment.token) << "no token is granted for two leases";
    ASSERT_TRUE(table_.WentTo(assignment.index, worker));
    ASSERT_EQ(table_.IndexOf(assignment.token), assignment.index);
    ASSERT_FALSE(committed_.contains(assignment.index));
    newest_[assignment.index] = assignment.token;
    working_[worker] = assignment;
  }

  // It is told that one again when it asks next, or somebody else is once this one is dead.
  void LookAhead(const std::string& worker, const Assignment& assignment) {
    const Assignment next = table_.Request(worker, now_, MarkOf(assignment.token));
    if (next.kind != Assignment::Kind::kWork) return;
    ASSERT_NE(next.token, assignment.token);
    ASSERT_FALSE(committed_.contains(next.index));
    granted_.insert(next.token);
    newest_[next.index] = next.token;
  }

  void HandIn(const Assignment& assignment, bool gives_back) {
    if (table_.Check(assignment.index, assignment.attempt, assignment.token) != LeaseValidity::kCurrent) return;
    ASSERT_EQ(newest_[assignment.index], assignment.token) << "only the newest token is current";
    ASSERT_FALSE(committed_.contains(assignment.index));
    if (gives_back) {
      table_.Release(assignment.index);
    } else if (FailsByNature(assignment.index, assignment.attempt)) {
      table_.Fail(assignment.index, Retry::kNextAttempt);
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
