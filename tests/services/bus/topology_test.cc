// SPDX-License-Identifier: Apache-2.0
// Tests services/bus/topology.cc
#include "services/bus/topology.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/core/stop.h"
#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace topology_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 86;

TEST(Endpoints, AreThoseOfAllParticipantsWithTheirQos) {
  const auto peers = OpenTwo(kDomain);
  auto writer = Writer<CampaignStatus>::Open(peers.a, "mine/0011");
  auto reader = Reader<CampaignStatus>::Open(peers.b, "mine/0011");
  ASSERT_TRUE(writer && reader);
  // the reader's side knows of the writer, too, once something came
  ASSERT_TRUE(writer->WaitForReaders(1, 10s));
  ASSERT_TRUE(writer->Write({}));
  ASSERT_TRUE(reader->Wait(10s));

  const auto all = Endpoints(peers.b);
  ASSERT_TRUE(all) << all.error().message;
  const auto find = [&](bool is_writer) {
    return std::ranges::find_if(*all, [&](const PeerEndpoint& endpoint) {
      return endpoint.topic == "etude/campaign/status" && endpoint.is_writer == is_writer;
    });
  };
  const auto other = find(true), own = find(false);
  ASSERT_NE(other, all->end());
  ASSERT_NE(own, all->end());
  EXPECT_EQ(other->participant, ParticipantId(peers.a));
  EXPECT_EQ(own->participant, ParticipantId(peers.b));
  EXPECT_EQ(other->partitions, std::vector<std::string>{"mine/0011"});
  EXPECT_NE(other->type.find("CampaignStatus"), std::string::npos);
  EXPECT_EQ(QosText(*other), "reliable, transient-local, last 1");
  EXPECT_EQ(Mismatch(*other, *own), "");
}

TEST(Mismatch, SaysWhatTheReaderAsksFor) {
  PeerEndpoint writer{.topic = "t", .type = "A", .is_writer = true, .reliable = true};
  PeerEndpoint reader = writer;
  reader.is_writer = false;
  EXPECT_EQ(Mismatch(writer, reader), "");
  reader.transient_local = true;
  EXPECT_EQ(Mismatch(writer, reader), "the reader asks for transient-local, the writer is volatile");
  writer.transient_local = true;
  reader.type = "B";
  EXPECT_EQ(Mismatch(writer, reader), "the reader's type is B, the writer's A");
  EXPECT_EQ(QosText(writer), "reliable, transient-local, all");
}

TEST(Echo, MessagesAreJsonByTheirFieldsNames) {
  const auto peers = OpenTwo(kDomain);
  auto writer = Writer<Observation>::Open(peers.a, "p");
  auto echo = Echo::Open(peers.b, "etude/policy/observation", "p");
  ASSERT_TRUE(writer);
  ASSERT_TRUE(echo) << echo.error().message;
  ASSERT_TRUE(writer->WaitForReaders(1, 10s));
  Observation observation;
  observation.session = "s";
  observation.instruction = "push the can";
  observation.request_id = 6285334756670210419u;
  observation.joints = {0.5f, 1.f};
  observation.width = observation.height = 2;
  observation.image.assign(12, 1);
  ASSERT_TRUE(writer->Write(observation));

  std::vector<nlohmann::ordered_json> taken;
  const Stopwatch watch;
  for (; taken.empty() && watch.Seconds() < 10; WaitForStop(1ms)) taken = (*echo)->Take();

  ASSERT_EQ(taken.size(), 1u);
  EXPECT_EQ(taken[0]["instruction"], "push the can");
  EXPECT_EQ(taken[0]["request_id"], 6285334756670210419u);
  EXPECT_EQ(taken[0]["joints"].dump(), "[0.5,1.0]");
  EXPECT_EQ(taken[0]["image"].dump(), R"({"bytes":12})");
}

TEST(Echo, KnowsEveryTopicAndNoOther) {
  const auto peers = OpenTwo(kDomain);
  for (const auto& topic : KnownTopics()) EXPECT_TRUE(Echo::Open(peers.a, topic, "all")) << topic;
  const auto none = Echo::Open(peers.a, "etude/campaign/statu", "all");
  ASSERT_FALSE(none);
  EXPECT_NE(none.error().message.find("did you mean 'etude/campaign/status'"), std::string::npos)
      << none.error().message;
}

}  // namespace topology_test
}  // namespace etude::bus
