// SPDX-License-Identifier: Apache-2.0
#include "services/bus/topic.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "services/bus/wire.h"
#include "services/core/clock.h"
#include "services/core/stop.h"
#include "tests/services/bus/example_message.h"
#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace topic_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 70;

template <class Message>
class EveryMessage : public testing::Test {};

TYPED_TEST_SUITE(EveryMessage, EveryMessageType);

TYPED_TEST(EveryMessage, ArrivesAsItWasWritten) {
  const auto peers = OpenTwo(kDomain);
  auto writer = Writer<TypeParam>::Open(peers.a, "round");
  auto reader = Reader<TypeParam>::Open(peers.b, "round");
  ASSERT_TRUE(writer && reader);
  ASSERT_TRUE(writer->WaitForReaders(1, 10s));
  const auto message = MakeMessage<TypeParam>();
  const auto written = writer->Write(message);
  ASSERT_TRUE(written) << written.error().message;
  ASSERT_TRUE(reader->Wait(10s));
  const auto taken = reader->Take();
  ASSERT_EQ(taken.size(), 1u);
  EXPECT_EQ(List(taken[0]), List(message));
  EXPECT_EQ(reader->malformed(), 0u);
  EXPECT_EQ(reader->matched_writers(), 1);
}

TYPED_TEST(EveryMessage, ArrivesEmptyOrIsRefused) {
  constexpr bool kMayBeEmpty = !std::is_same_v<TypeParam, BlobManifest> && !std::is_same_v<TypeParam, BlobChunk>;
  const auto peers = OpenTwo(kDomain);
  auto writer = Writer<TypeParam>::Open(peers.a, "empty");
  auto reader = Reader<TypeParam>::Open(peers.b, "empty");
  ASSERT_TRUE(writer && reader);
  ASSERT_TRUE(writer->WaitForReaders(1, 10s));
  ASSERT_EQ(writer->Write(TypeParam{}).has_value(), kMayBeEmpty);
  if (!kMayBeEmpty) return;
  ASSERT_TRUE(reader->Wait(10s));
  const auto taken = reader->Take();
  ASSERT_EQ(taken.size(), 1u);
  EXPECT_EQ(List(taken[0]), List(TypeParam{}));
}

TEST(Topic, LateJoinerGetsTheNewestState) {
  const auto peers = OpenTwo(kDomain);
  auto writer = Writer<CampaignStatus>::Open(peers.a, "late");
  ASSERT_TRUE(writer);
  for (const char* campaign : {"one", "two"}) {
    for (std::uint64_t i = 1; i <= 3; ++i) {
      CampaignStatus status;
      status.campaign = campaign;
      status.committed = i;
      ASSERT_TRUE(writer->Write(status));
    }
  }
  auto reader = Reader<CampaignStatus>::Open(peers.b, "late");
  ASSERT_TRUE(reader);
  std::vector<CampaignStatus> all;
  while (all.size() < 2 && reader->Wait(10s)) {
    for (auto& status : reader->Take()) all.push_back(status);
  }
  ASSERT_EQ(all.size(), 2u);
  for (const auto& status : all) EXPECT_EQ(status.committed, 3u) << status.campaign;
}

TEST(Topic, DisposedStateIsNotGivenToLateJoiners) {
  const auto peers = OpenTwo(kDomain);
  auto writer = Writer<CampaignAnnouncement>::Open(peers.a, "gone");
  ASSERT_TRUE(writer);
  CampaignAnnouncement gone;
  gone.campaign = "gone";
  CampaignAnnouncement here;
  here.campaign = "here";
  ASSERT_TRUE(writer->Write(gone));
  ASSERT_TRUE(writer->Dispose(gone));
  ASSERT_TRUE(writer->Write(here));
  auto reader = Reader<CampaignAnnouncement>::Open(peers.b, "gone");
  ASSERT_TRUE(reader);
  std::vector<CampaignAnnouncement> all;
  while (all.empty() && reader->Wait(10s)) all = reader->Take();
  ASSERT_EQ(all.size(), 1u);
  EXPECT_EQ(all[0].campaign, "here");
}

TEST(Topic, LiveIsWhatWritersThatAreThereSaidLast) {
  const auto peers = OpenTwo(kDomain);
  auto reader = Reader<CampaignStatus>::Open(peers.b, "live");
  auto stays = Writer<CampaignStatus>::Open(peers.a, "live");
  ASSERT_TRUE(reader && stays);
  const auto counts = [&] {
    std::vector<std::uint64_t> found;
    for (const auto& status : reader->Live()) found.push_back(status.committed);
    std::sort(found.begin(), found.end());
    return found;
  };
  const auto wait_for = [&](const std::vector<std::uint64_t>& expected) {
    const Stopwatch watch;
    while (counts() != expected && watch.Seconds() < 10) WaitForStop(1ms);
    EXPECT_EQ(counts(), expected);
  };
  const auto say = [](Writer<CampaignStatus>& writer, const char* campaign, std::uint64_t committed) {
    CampaignStatus status;
    status.campaign = campaign;
    status.committed = committed;
    ASSERT_TRUE(writer.Write(status));
  };
  say(*stays, "one", 1);
  say(*stays, "one", 2);
  wait_for({2});
  {
    auto goes = Writer<CampaignStatus>::Open(peers.a, "live");
    ASSERT_TRUE(goes);
    say(*goes, "two", 5);
    wait_for({2, 5});
    wait_for({2, 5});  // looking takes nothing away
  }
  wait_for({2});
  EXPECT_FALSE(reader->Take().empty());  // also after a loan that was larger than what Take asks for
  EXPECT_TRUE(counts().empty());
}

TEST(Topic, PartitionsAreApart) {
  const auto peers = OpenTwo(kDomain);
  auto writer = Writer<WorkRequest>::Open(peers.a, "mine");
  auto mine = Reader<WorkRequest>::Open(peers.b, "mine");
  auto other = Reader<WorkRequest>::Open(peers.b, "other");
  ASSERT_TRUE(writer && mine && other);
  ASSERT_TRUE(writer->WaitForReaders(1, 10s));
  ASSERT_TRUE(writer->Write({"c", "w", 1, "v"}));
  ASSERT_TRUE(mine->Wait(10s));
  EXPECT_EQ(mine->Take().size(), 1u);
  EXPECT_EQ(writer->matched_readers(), 1);
  EXPECT_EQ(other->matched_writers(), 0);
  EXPECT_TRUE(other->Take().empty());
}

TEST(Topic, EventsAreNotReplaced) {
  const auto peers = OpenTwo(kDomain);
  auto writer = Writer<WorkRequest>::Open(peers.a, "events");
  auto reader = Reader<WorkRequest>::Open(peers.b, "events");
  ASSERT_TRUE(writer && reader);
  ASSERT_TRUE(writer->WaitForReaders(1, 10s));
  constexpr std::uint64_t kCount = 500;
  for (std::uint64_t i = 0; i < kCount; ++i) ASSERT_TRUE(writer->Write({"c", "w", i, "v"}));
  std::vector<WorkRequest> all;
  while (all.size() < kCount && reader->Wait(10s)) {
    for (auto& request : reader->Take(7)) all.push_back(request);  // leaves some for the next Wait
  }
  ASSERT_EQ(all.size(), kCount);
  for (std::uint64_t i = 0; i < kCount; ++i) EXPECT_EQ(all[i].request_id, i);
}

TEST(Topic, WaitEndsWithTheTimeout) {
  const auto peers = OpenTwo(kDomain);
  auto reader = Reader<WorkRequest>::Open(peers.a, "silence");
  ASSERT_TRUE(reader);
  EXPECT_FALSE(reader->Wait(1ms));
  EXPECT_FALSE(reader->Wait(0ms));
}

TEST(Topic, RefusesWhatDoesNotFitTheWire) {
  const auto peers = OpenTwo(kDomain);
  auto writer = Writer<WorkRequest>::Open(peers.a, "long");
  ASSERT_TRUE(writer);
  const auto too_long = writer->Write({"c", std::string(129, 'w'), 1, "v"});
  ASSERT_FALSE(too_long);
  EXPECT_EQ(too_long.error().code, Code::kInvalidArgument);
  EXPECT_NE(too_long.error().message.find("worker has 129"), std::string::npos) << too_long.error().message;
  EXPECT_FALSE(writer->Write({"c", std::string("a\0b", 3), 1, "v"}));
  EXPECT_TRUE(writer->Write({"c", std::string(128, 'w'), 1, "v"}));
}

TEST(Topic, RefusesWildcardPartitionsAndEmptyParts) {
  const auto peers = OpenTwo(kDomain);
  for (const char* name : {"", "a*", "a?", "[a]", "a b", "a/", "/a", "a//b"}) {
    const auto writer = Writer<WorkRequest>::Open(peers.a, name);
    ASSERT_FALSE(writer) << name;
    EXPECT_EQ(writer.error().code, Code::kInvalidArgument);
  }
}

}  // namespace topic_test
}  // namespace etude::bus
