// SPDX-License-Identifier: Apache-2.0
// Collectors are presences and announcements that the test writes.
#include "services/campaign/known_collectors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "tests/support/matchers.h"
#include "tests/support/wait_until.h"

namespace etude::campaign {
namespace known_collectors_test {

constexpr std::uint32_t kDomain = 85;

// What a collector says of itself; it is there for as long as it lives.
class Said {
 public:
  Said(const bus::Participant& participant, const std::string& id, std::uint32_t shard, std::uint32_t shards,
       const std::string& spec_sha256 = "spec")
      : presence_(bus::MakePresence(bus::PresenceKind::kCampaign, Name(), id, "")) {
    presence_.shard = shard;
    presence_.shards = shards;
    presence_.spec_sha256 = spec_sha256;
    auto there = bus::Announcement::Open(participant, presence_, Claim::kAdopt);
    EXPECT_THAT(there, IsOk());
    there_.emplace(std::move(*there));
    auto writer = bus::Writer<bus::CampaignAnnouncement>::Open(participant, bus::Owner{Name(), id}.partition());
    EXPECT_THAT(writer, IsOk());
    writer_.emplace(std::move(*writer));
    Announce(1, false);
  }
  void Announce(std::uint64_t epoch, bool complete) {
    bus::CampaignAnnouncement said;
    said.campaign = Name();
    said.campaign_id = presence_.id;
    said.epoch = epoch;
    said.complete = complete;
    EXPECT_THAT(writer_->Write(said), IsOk());
  }
  static std::string Name() { return "known-" + std::to_string(::getpid()); }

 private:
  bus::Presence presence_;
  std::optional<bus::Announcement> there_;
  std::optional<bus::Writer<bus::CampaignAnnouncement>> writer_;
};

class KnownCollectorsTest : public testing::Test {
 protected:
  void SetUp() override {
    auto opened = bus::Participant::Open({kDomain, ""});
    ASSERT_THAT(opened, IsOk());
    participant_ = std::make_unique<bus::Participant>(std::move(*opened));
    auto known = KnownCollectors::Open(*participant_, {Said::Name(), ""});
    ASSERT_THAT(known, IsOk());
    known_ = std::make_unique<KnownCollectors>(std::move(*known));
  }
  bool Opens(const std::set<std::uint32_t>& shards) {
    return WaitUntil([&] {
      EXPECT_THAT(known_->LookAround(), IsOk());
      return known_->OpenShards() == shards;
    });
  }
  bool Completes() {
    return WaitUntil([&] {
      EXPECT_THAT(known_->Learn(), IsOk());
      return known_->Complete();
    });
  }

  std::unique_ptr<bus::Participant> participant_;
  std::unique_ptr<KnownCollectors> known_;
};

TEST_F(KnownCollectorsTest, NobodyIsThere) {
  EXPECT_EQ(known_->LookAround().value(), false);
  EXPECT_TRUE(known_->empty());
  EXPECT_FALSE(known_->Complete()) << "nothing is known of it";
  EXPECT_THAT(known_->OpenShards(), testing::IsEmpty());
}

TEST_F(KnownCollectorsTest, ShardsMayBeginLaterAndEndBeforeTheOthers) {
  Said first(*participant_, "aaaa000000000001", 1, 3);
  ASSERT_TRUE(Opens({1}));
  auto third = std::make_unique<Said>(*participant_, "cccc000000000003", 3, 3);
  ASSERT_TRUE(Opens({1, 3}));

  third->Announce(1, true);
  ASSERT_TRUE(Opens({1}));
  EXPECT_FALSE(known_->Complete());
  third.reset();
  first.Announce(1, true);
  EXPECT_TRUE(Completes()) << "what the one that has gone said last counts";
}

TEST_F(KnownCollectorsTest, WhatAWorkerWasToldHoldsForThatLifeOfTheCollectorAlone) {
  Said only(*participant_, "aaaa000000000001", 0, 0);
  ASSERT_TRUE(Opens({0}));
  const auto collector = known_->At(0);
  ASSERT_TRUE(WaitUntil([&] {
    collector->TakeAnnouncements();
    return collector->announcement.has_value();
  }));
  collector->done_in = 1;
  EXPECT_TRUE(known_->Complete());
  only.Announce(2, false);
  ASSERT_TRUE(Opens({0})) << "it was started again with more to do";
  EXPECT_FALSE(known_->Complete());
}

TEST_F(KnownCollectorsTest, AShardThatGoesOnElsewhereIsAnotherCollector) {
  Said first(*participant_, "aaaa000000000001", 1, 2);
  auto second = std::make_unique<Said>(*participant_, "bbbb000000000002", 2, 2);
  ASSERT_TRUE(Opens({1, 2}));
  const auto known = known_->At(2);
  EXPECT_TRUE(known_->Knows(*known));
  second = std::make_unique<Said>(*participant_, "dddd000000000004", 2, 2);

  EXPECT_TRUE(WaitUntil([&] {
    EXPECT_THAT(known_->Learn(), IsOk());
    return !known_->Knows(*known);
  }));
  EXPECT_EQ(known_->At(2)->presence.id, "dddd000000000004");
  EXPECT_TRUE(WaitUntil([&] { return known_->HasGone("bbbb000000000002"); }));
}

TEST_F(KnownCollectorsTest, AnotherCampaignOfTheNameTakesThePlaceOfOneThatHasGone) {
  auto old = std::make_unique<Said>(*participant_, "aaaa000000000001", 0, 0);
  ASSERT_TRUE(Opens({0}));
  EXPECT_FALSE(known_->Replaced("aaaa000000000001"));
  old.reset();
  const Said anew(*participant_, "eeee000000000005", 0, 0);
  ASSERT_TRUE(WaitUntil([&] { return known_->Replaced("aaaa000000000001"); }));

  EXPECT_EQ(known_->LookAround().value(), true);
  EXPECT_EQ(known_->At(0)->presence.id, "eeee000000000005");
  EXPECT_EQ(known_->LookAround().value(), false) << "said once";
}

TEST_F(KnownCollectorsTest, ANameOfTwoCampaignsIsAnsweredByTheirList) {
  const Said one(*participant_, "aaaa000000000001", 0, 0), other(*participant_, "bbbb000000000002", 0, 0);
  ASSERT_TRUE(WaitUntil([&] { return !known_->LookAround(); }));
  const auto refused = known_->LookAround();
  EXPECT_THAT(refused, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(refused, MessageHas("bbbb000000000002"));
}

}  // namespace known_collectors_test
}  // namespace etude::campaign
