// SPDX-License-Identifier: Apache-2.0
// Tests services/bus/process_reporter.cc, and what endpoints count
#include "services/bus/process_reporter.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <nlohmann/json.hpp>
#include <optional>

#include "services/bus/access.h"
#include "services/bus/topic.h"
#include "services/bus/topology.h"
#include "services/core/clock.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace process_reporter_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 108;

template <class Message>
std::vector<Message> TakeUntil(Reader<Message>& reader, std::size_t count) {
  std::vector<Message> all;
  while (all.size() < count && reader.Wait(10s))
    for (auto& message : reader.Take()) all.push_back(std::move(message));
  return all;
}

TEST(ProcessReporter, SaysHowTheProcessIs) {
  const auto peers = OpenTwo(kDomain);
  auto statuses = Reader<ProcessStatus>::Open(peers.b, kDirectoryPartition);
  ASSERT_TRUE(statuses);
  auto reporter = ProcessReporter::Start(peers.a, {.role = "worker", .folder = "/tmp", .every = 20ms});
  ASSERT_TRUE(reporter) << reporter.error().message;

  const auto taken = TakeUntil(*statuses, 2);

  ASSERT_GE(taken.size(), 2u) << "again and again";
  const ProcessStatus& status = taken.back();
  EXPECT_EQ(status.process, (*reporter)->process());
  EXPECT_EQ(status.role, "worker");
  EXPECT_EQ(status.host, HostName());
  EXPECT_EQ(status.pid, static_cast<std::uint32_t>(::getpid()));
  EXPECT_FALSE(status.version.empty());
  EXPECT_GT(status.rss_bytes, 0u);
  EXPECT_GT(status.disk_total_bytes, 0u);
  EXPECT_EQ(status.folder, "/tmp");
  EXPECT_EQ(status.participant, ParticipantId(peers.a));
  EXPECT_EQ(status.participant.size(), 32u);
}

TEST(ProcessReporter, CountsWhatGoesThroughEachTopic) {
  const auto peers = OpenTwo(kDomain);
  auto statuses = Reader<ProcessStatus>::Open(peers.b, kDirectoryPartition);
  auto writer = Writer<WorkRequest>::Open(peers.a, "counts");
  auto reader = Reader<WorkRequest>::Open(peers.b, "counts");
  ASSERT_TRUE(statuses && writer && reader);
  ASSERT_TRUE(writer->WaitForReaders(1, 10s));
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(writer->Write({"c", "w", 1, "v"}));
  auto reporter = ProcessReporter::Start(peers.a, {.role = "worker", .every = 20ms});
  ASSERT_TRUE(reporter);

  const auto taken = TakeUntil(*statuses, 1);

  ASSERT_FALSE(taken.empty());
  std::optional<nlohmann::json> topic;
  for (const auto& one : nlohmann::json::parse(taken[0].topics_json))
    if (one["topic"] == "etude/campaign/request") topic = one;
  ASSERT_TRUE(topic) << taken[0].topics_json;
  EXPECT_EQ((*topic)["kind"], "writer");
  EXPECT_EQ((*topic)["samples"], 3);
  EXPECT_GE((*topic)["bytes"], 3 * 11);
  EXPECT_EQ((*topic)["matched"], 1);
}

TEST(ProcessReporter, PublishesWarningsAlsoForThoseWhoComeLater) {
  const auto peers = OpenTwo(kDomain);
  InitLog("test", "info");
  auto reporter = ProcessReporter::Start(peers.a, {.role = "worker", .every = 20ms});
  ASSERT_TRUE(reporter);
  for (int i = 0; i < 5; ++i) Log().warn("a lease expired count={}", i);
  Log().info("nobody needs to know");

  auto events = Reader<ProcessEvent>::Open(peers.b, kDirectoryPartition);
  ASSERT_TRUE(events);
  const auto taken = TakeUntil(*events, 5);

  ASSERT_EQ(taken.size(), 5u);
  for (std::size_t i = 0; i < taken.size(); ++i) {
    EXPECT_EQ(taken[i].number, i + 1);
    EXPECT_EQ(taken[i].text, "a lease expired count=" + std::to_string(i));
    EXPECT_EQ(taken[i].code, "a_lease_expired");
    EXPECT_EQ(taken[i].level, "warn");
    EXPECT_EQ(taken[i].process, (*reporter)->process());
  }
}

TEST(ProcessReporter, AFloodOfWarningsHasABound) {
  const auto peers = OpenTwo(kDomain);
  InitLog("test", "error");
  auto reporter = ProcessReporter::Start(peers.a, {.role = "worker", .every = 20ms});
  ASSERT_TRUE(reporter);
  for (int i = 0; i < 5000; ++i) Log().error("flood {}", std::string(2000, 'x'));
  auto events = Reader<ProcessEvent>::Open(peers.b, kDirectoryPartition);
  ASSERT_TRUE(events);
  // the newest is the last of them, and no more than the last ones are kept
  std::vector<ProcessEvent> taken;
  const Stopwatch watch;
  while ((taken.empty() || taken.back().number < 5000) && watch.Seconds() < 20 && events->Wait(10s))
    for (auto& event : events->Take()) taken.push_back(std::move(event));
  ASSERT_FALSE(taken.empty());
  EXPECT_EQ(taken.back().number, 5000u);
  EXPECT_LE(taken.back().text.size(), 1000u);
  InitLog("test", "info");
}

}  // namespace process_reporter_test
}  // namespace etude::bus
