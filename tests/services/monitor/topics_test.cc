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
  rates.Hear(processes);
  // who is heard later counts from then on: in a star that is most of them
  processes["late"] = {status(7), kNow + 2s};
  rates.Hear(processes);
  processes["p"] = {status(30), kNow + 4s};
  processes["late"] = {status(9), kNow + 4s};
  processes["new"] = {status(99), kNow + 4s};

  const auto found = rates.End(processes);

  ASSERT_EQ(found.size(), 1u);
  EXPECT_DOUBLE_EQ(found.at("t").samples_per_second, 5 + 1);
  EXPECT_DOUBLE_EQ(found.at("t").bytes_per_second, 500 + 100);
  EXPECT_EQ(found.at("t").writers, 2);
}

// of a stranger, too
TEST(Written, TakesWhatParsesAndNothingElse) {
  bus::ProcessStatus process;
  for (const char* text : {"", "{}", "[", "[[[[[1]]]]]", "7", R"([{"topic": 3, "kind": "writer"}])",
                           R"([{"topic": "t"}])", R"([{"kind": "writer", "samples": 1}])"}) {
    process.topics_json = text;
    EXPECT_TRUE(Written(process).empty()) << text;
  }
  process.topics_json =
      R"([{"topic": "a", "kind": "writer", "samples": "many"}, {"topic": "b", "kind": "writer", "bytes": 2.5}])";
  const auto counts = Written(process);
  ASSERT_EQ(counts.size(), 2u);
  EXPECT_EQ(counts.at("a").samples, 0);
  EXPECT_EQ(counts.at("b").bytes, 2.5);
}

TEST(TopicRates, NeverFallBelowNothing) {
  const auto process = [](const std::string& name, int bytes, MonotonicClock::time_point at) {
    bus::ProcessStatus status;
    status.process = name;
    status.topics_json = fmt::format(R"([{{"topic": "t", "kind": "writer", "samples": {0}, "bytes": {0}}}])", bytes);
    return Heard<bus::ProcessStatus>{status, at};
  };
  TopicRates rates;
  rates.Hear({{"again", process("again", 1000, kNow)},
              {"still", process("still", 100, kNow)},
              {"left", process("left", 7, kNow)},
              {"late", process("late", 0, kNow + 5s)}});
  const auto found = rates.End({{"again", process("again", 10, kNow + 2s)},  // began anew: counts from 0
                                {"still", process("still", 300, kNow + 2s)},
                                {"late", process("late", 50, kNow + 5s)}});  // no time has passed
  ASSERT_EQ(found.size(), 1u);
  EXPECT_DOUBLE_EQ(found.at("t").bytes_per_second, 100);
  EXPECT_EQ(found.at("t").writers, 2);
}

TEST(PeerNames, AreByTheParticipantThatDiscoveryShows) {
  bus::ProcessStatus process;
  process.process = "p", process.participant = "0110:0a", process.role = "worker", process.pid = 4711;
  process.host = "lab-7";
  const auto names = PeerNames({{"p", {process, kNow}}});
  ASSERT_EQ(names.size(), 1u);
  EXPECT_EQ(names.at("0110:0a"), "worker 4711@lab-7");
}

TEST(IsBulk, IsWhatCarriesEpisodesAndCheckpoints) {
  EXPECT_TRUE(IsBulk("etude/blob/chunk"));
  EXPECT_TRUE(IsBulk("etude/blob/manifest"));
  for (const char* other : {"etude/blob/ack", "etude/campaign/status", "", "etude/blob/chunks"})
    EXPECT_FALSE(IsBulk(other)) << other;
}

}  // namespace topics_test
}  // namespace etude::monitor
