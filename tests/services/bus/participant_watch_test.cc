// SPDX-License-Identifier: Apache-2.0
// Tests services/bus/participant_watch.cc
#include "services/bus/participant_watch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace etude::bus {
namespace participant_watch_test {

using ::testing::HasSubstr;

TEST(PeerJudge, FindsWhoWasLostOnThisSideOnlyWithinOneLease) {
  PeerJudge judge(10);
  EXPECT_TRUE(judge.Look({{"a"}, {"a"}}, 0).lost.empty());
  EXPECT_TRUE(judge.Look({{}, {}}, 10).lost.empty());
  EXPECT_TRUE(judge.Look({{"a", "new"}, {}}, 20).lost.empty()) << "a handshake may be under way";
  EXPECT_TRUE(judge.Look({{"a", "new"}, {}}, 29).lost.empty());
  EXPECT_EQ(judge.Look({{"a", "new"}, {}}, 30).lost, std::set<std::string>{"a"}) << "`new` was never admitted";
  EXPECT_EQ(judge.Look({{"a"}, {}}, 31).lost, std::set<std::string>{"a"}) << "still";
  EXPECT_TRUE(judge.Look({{"a"}, {"a"}}, 32).lost.empty()) << "it came back by itself";
  EXPECT_TRUE(judge.Look({{"a"}, {}}, 33).lost.empty()) << "a new count";
  EXPECT_TRUE(judge.Look({{}, {}}, 50).lost.empty()) << "it has gone for good";
}

TEST(PeerJudge, NobodyIsLostWhileThoseWhoWaitAreAdmittedOneAfterTheOther) {
  PeerJudge judge(7);
  PeersSeen all{{"a", "b", "c"}, {"a", "b", "c"}}, none{{"a", "b", "c"}, {}};
  (void)judge.Look(all, 0);
  (void)judge.Look({}, 20);  // a switch restarts
  EXPECT_TRUE(judge.Look(none, 30).lost.empty());
  EXPECT_TRUE(judge.Look({none.seen, {"a"}}, 36).lost.empty());
  EXPECT_TRUE(judge.Look({none.seen, {"a", "b"}}, 42).lost.empty()) << "12 s, and it moves";
  EXPECT_EQ(judge.Look({none.seen, {"a", "b"}}, 50).lost, std::set<std::string>{"c"}) << "now it does not";
}

TEST(PeerJudge, WhoComesAndGoesKeepsNoLostOneWaitingForEver) {
  PeerJudge judge(7);
  (void)judge.Look({{"a"}, {"a"}}, 0);
  bool lost = false;
  for (int s = 10; s <= 50 && !lost; s += 2) {
    const std::string other = "new-" + std::to_string(s);
    (void)judge.Look({{"a", other}, {}}, s);
    lost = !judge.Look({{"a", other}, {other}}, s + 1).lost.empty();
    EXPECT_EQ(lost, s + 1 >= 10 + PeerJudge::kPatienceS) << s;
  }
  EXPECT_TRUE(lost);
}

TEST(PeerJudge, KnowsWhenNobodyAdmitsIt) {
  PeerJudge judge;
  EXPECT_FALSE(judge.Look({{"a"}, {}}, 0).alone);
  EXPECT_TRUE(judge.Look({{"a"}, {}}, 31).alone);
  PeerJudge admitted;
  (void)admitted.Look({{"hub"}, {"hub"}, {"hub"}}, 0);
  (void)admitted.Look({{"hub", "stranger"}, {"hub"}, {"hub"}}, 1);
  EXPECT_FALSE(admitted.Look({{"hub", "stranger"}, {"hub"}, {"hub"}}, 60).alone);
}

TEST(PeerJudge, ARackThatTheHubDoesNotKnowAnyMoreLeaves) {
  PeerJudge rack;
  (void)rack.Look({{"hub", "mate"}, {"hub", "mate"}, {"hub"}}, 0);
  EXPECT_FALSE(rack.Look({{"hub-2", "mate"}, {"mate"}}, 5).alone);
  EXPECT_TRUE(rack.Look({{"hub-2", "mate"}, {"mate"}}, 36).alone) << "the hub was started again with a new list";
  PeerJudge waits;
  (void)waits.Look({{"hub", "stranger"}, {"hub"}, {"hub"}}, 0);
  (void)waits.Look({{"hub", "stranger"}, {"hub"}, {"hub"}}, 100);
  EXPECT_FALSE(waits.Look({{"stranger"}, {}}, 200).alone) << "its collector is away";
}

// before, it knocked for ever where the hub came more than five minutes after it
TEST(PeerJudge, ARackThatNeverHadAHubLeavesWheneverAForeignOneComes) {
  PeerJudge rack;
  for (int s = 0; s <= 600; s += 100) EXPECT_FALSE(rack.Look({{"mate"}, {"mate"}}, s).alone);
  EXPECT_FALSE(rack.Look({{"mate", "hub"}, {"mate"}}, 601).alone);
  EXPECT_TRUE(rack.Look({{"mate", "hub"}, {"mate"}}, 632).alone);
}

TEST(Hubs, AreToldByWhatAProcessDoesNotByAllThatItMay) {
  using security::Role;
  security::Identity identity;
  identity.roles = {Role::kWorker, Role::kCollector};
  EXPECT_FALSE(IsHub({Role::kWorker}, identity)) << "it would knock for ever";
  EXPECT_TRUE(IsHub({Role::kCollector}, identity));
  EXPECT_TRUE(IsHub({}, identity)) << "it did not say what it does";
}

TEST(Dates, AreWarnedOfOnceAndEndTheProcessBeforeTheLibraryFallsSilent) {
  security::Identity identity;
  identity.name = "rack-1";
  identity.not_before = 1'000'000;
  identity.not_after = 1'100'000;
  EXPECT_FALSE(LookAtDates(identity, 1'079'999).soon);
  const auto warned = LookAtDates(identity, 1'080'000);
  ASSERT_TRUE(warned.soon);
  EXPECT_FALSE(warned.over);
  EXPECT_THAT(*warned.soon, HasSubstr("rack-1"));
  const auto over = LookAtDates(identity, 1'099'700);
  ASSERT_TRUE(over.over) << "five minutes before: by a clock that is four minutes slow, one";
  EXPECT_THAT(over.over->message, HasSubstr("expires on"));
}

}  // namespace participant_watch_test
}  // namespace etude::bus
