// SPDX-License-Identifier: Apache-2.0
// What the endpoints really use, asked of DDS.
#include "services/bus/qos.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "services/bus/typed.h"
#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace qos_test {

struct Seen {
  dds_durability_kind_t durability{};
  dds_history_kind_t history{};
  std::int32_t depth = 0;
  dds_reliability_kind_t reliability{};
  dds_duration_t blocking = 0;
  dds_history_kind_t service_history{};
  std::int32_t service_depth = 0;
};

Seen Look(const Endpoint& endpoint) {
  const Qos qos(dds_create_qos());
  EXPECT_EQ(dds_get_qos(endpoint.get(), qos.get()), DDS_RETCODE_OK);
  Seen seen;
  EXPECT_TRUE(dds_qget_durability(qos.get(), &seen.durability));
  EXPECT_TRUE(dds_qget_history(qos.get(), &seen.history, &seen.depth));
  EXPECT_TRUE(dds_qget_reliability(qos.get(), &seen.reliability, &seen.blocking));
  if (endpoint.is_writer) {
    dds_duration_t delay = -1;
    std::int32_t samples = 0, instances = 0, per_instance = 0;
    EXPECT_TRUE(dds_qget_durability_service(qos.get(), &delay, &seen.service_history, &seen.service_depth, &samples,
                                            &instances, &per_instance));
    EXPECT_EQ(delay, 0);
    bool autodispose = false;
    EXPECT_TRUE(dds_qget_writer_data_lifecycle(qos.get(), &autodispose));
    EXPECT_TRUE(autodispose);
  }
  return seen;
}

void Expect(const Endpoint& endpoint, bool transient_local, int keep_last, int blocking_ms = 1000) {
  const Seen seen = Look(endpoint);
  if (endpoint.is_writer) {
    EXPECT_EQ(seen.blocking, DDS_MSECS(blocking_ms));
  }
  EXPECT_EQ(seen.reliability, DDS_RELIABILITY_RELIABLE);
  EXPECT_EQ(seen.durability, transient_local ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  EXPECT_EQ(seen.history, keep_last > 0 ? DDS_HISTORY_KEEP_LAST : DDS_HISTORY_KEEP_ALL);
  if (keep_last > 0) {
    EXPECT_EQ(seen.depth, keep_last);
  }
  if (endpoint.is_writer && transient_local) {
    EXPECT_EQ(seen.service_history, DDS_HISTORY_KEEP_LAST);
    EXPECT_EQ(seen.service_depth, std::max(keep_last, 1)) << "what late joiners get";
  }
}

template <class Message>
void ExpectBoth(const Participant& participant, bool transient_local, int keep_last, int blocking_ms = 1000) {
  SCOPED_TRACE(Traits<Message>::kTopic);
  const auto writer = OpenWriterOf<Message>(participant, "qos");
  const auto reader = OpenReaderOf<Message>(participant, "qos");
  ASSERT_TRUE(writer && reader);
  Expect(*writer, transient_local, keep_last, blocking_ms);
  Expect(*reader, transient_local, keep_last, blocking_ms);
}

TEST(QosOfTopics, IsWhatTheTableSays) {
  const auto peers = OpenTwo(70);
  ExpectBoth<Presence>(peers.a, true, 1);
  ExpectBoth<CampaignAnnouncement>(peers.a, true, 1);
  ExpectBoth<WorkRequest>(peers.a, false, 0);
  ExpectBoth<Lease>(peers.a, false, 0, 20);
  ExpectBoth<WorkerStatus>(peers.a, false, 1);
  ExpectBoth<AttemptReport>(peers.a, false, 0);
  ExpectBoth<CampaignStatus>(peers.a, true, 1);
  ExpectBoth<BlobManifest>(peers.a, false, 0);
  ExpectBoth<BlobChunk>(peers.a, false, 0);
  ExpectBoth<BlobAck>(peers.a, false, 0, 20);
  ExpectBoth<Observation>(peers.a, false, 1);
  ExpectBoth<Action>(peers.a, false, 1);
  ExpectBoth<Insight>(peers.a, false, 16);
  ExpectBoth<TrainStatus>(peers.a, true, 1);
  ExpectBoth<CampaignControl>(peers.a, false, 0);
  ExpectBoth<PolicyStatus>(peers.a, true, 1);
  ExpectBoth<PlayCommand>(peers.a, false, 0);
  ExpectBoth<PlayState>(peers.a, false, 1);
  ExpectBoth<PlayFrame>(peers.a, false, 1);
  ExpectBoth<ProcessStatus>(peers.a, false, 1);
  ExpectBoth<ProcessEvent>(peers.a, true, 64);
}

TEST(QosOfTopics, PublishedBlobsThrottleTheWriterAndKeepTheLast) {
  const auto peers = OpenTwo(70);
  const auto writer =
      OpenWriter(peers.a, "qos", etude_wire_PublishedChunk_desc, kPublishedChunkTopic, kPublishedWriter);
  const auto reader =
      OpenReader(peers.a, "qos", etude_wire_PublishedChunk_desc, kPublishedChunkTopic, kPublishedReader);
  ASSERT_TRUE(writer && reader);
  Expect(*writer, true, 0);
  Expect(*reader, true, 1);
}

}  // namespace qos_test
}  // namespace etude::bus
