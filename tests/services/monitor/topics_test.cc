// SPDX-License-Identifier: Apache-2.0
// Tests services/monitor/topics.cc
#include "services/monitor/topics.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace etude::monitor {
namespace topics_test {

using testing::ElementsAre;
using namespace std::chrono_literals;

const MonotonicClock::time_point kNow{1000s};

bus::PeerEndpoint Endpoint(bool is_writer, const std::string& participant) {
  return {.topic = "etude/campaign/status",
          .type = "CampaignStatus",
          .is_writer = is_writer,
          .partitions = {"mine/0011"},
          .participant = participant,
          .reliable = true};
}

TEST(TopicRows, AreByTopicAndLeaveTheLookerOut) {
  auto reader = Endpoint(false, "b");
  reader.transient_local = true;
  const auto rows = TopicRows({Endpoint(true, "a"), reader, Endpoint(false, "me")}, "me");
  ASSERT_EQ(rows.size(), 1u);
  const TopicRow& row = rows.begin()->second;
  EXPECT_EQ(row.writers.size(), 1u);
  EXPECT_EQ(row.readers.size(), 1u);
  EXPECT_THAT(row.problems, ElementsAre("the reader asks for transient-local, the writer is volatile"));
  const auto json = TopicJson("etude/campaign/status", row, {{"a", "collector 7@lab"}});
  EXPECT_EQ(json["writers"][0]["peer"], "collector 7@lab");
  EXPECT_EQ(json["readers"][0]["peer"], "");
}

TEST(WrittenPartitions, AreThoseOfWriters) {
  const auto partitions = WrittenPartitions({Endpoint(true, "a"), Endpoint(false, "b")}, "etude/campaign/status");
  EXPECT_THAT(partitions, ElementsAre("mine/0011"));
  EXPECT_TRUE(WrittenPartitions({Endpoint(false, "b")}, "etude/campaign/status").empty());
}

TEST(TopicRates, AreDifferencesOfWhatWritersCount) {
  const auto status = [](std::uint64_t samples) {
    bus::ProcessStatus process;
    process.process = "p";
    process.topics_json = fmt::format(R"([{{"topic": "t", "kind": "writer", "samples": {}, "bytes": {}}},)"
                                      R"({{"topic": "t", "kind": "reader", "samples": 9, "bytes": 9}}, 3, {{}}])",
                                      samples, 100 * samples);
    return process;
  };
  Processes processes;
  processes["p"] = {status(10), kNow};
  TopicRates rates;
  rates.Begin(processes);
  processes["p"] = {status(30), kNow + 4s};
  processes["new"] = {status(99), kNow + 4s};

  const auto found = rates.End(processes);

  ASSERT_EQ(found.size(), 1u);
  EXPECT_DOUBLE_EQ(found.at("t").samples_per_second, 5);
  EXPECT_DOUBLE_EQ(found.at("t").bytes_per_second, 500);
  EXPECT_EQ(found.at("t").writers, 1);
}

}  // namespace topics_test
}  // namespace etude::monitor
