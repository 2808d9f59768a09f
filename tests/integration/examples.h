// SPDX-License-Identifier: Apache-2.0
// deploy/examples against a real policy server with a real checkpoint, and a real publisher of it.
#pragma once

#include <gtest/gtest.h>

#include <cstdio>
#include <sstream>

#include "services/bus/blob_transfer.h"
#include "services/bus/directory.h"
#include "services/campaign/process.h"
#include "services/core/hash.h"

namespace etude {

struct ExampleOutcome {
  int exit_code = -1;
  std::string text;
};

inline ExampleOutcome RunExample(std::vector<std::string> argv, const Path& log) {
  std::filesystem::remove(log);
  auto process = campaign::Process::Start({std::move(argv), log, {}});
  if (!process) return {-1, process.error().message};
  const int exit_code = process->Wait(std::chrono::seconds(120)).value_or(-1);
  return {exit_code, ReadTextFile(log).value_or("")};
}

/// The driver is answered, keeps its limits, and stands still once the server has gone.
inline void ExpectDriverFollowsAPolicy(const Path& programs, const Path& checkpoint, int domain, const Path& folder) {
  const std::string domain_text = std::to_string(domain);
  auto server = campaign::Process::Start({{(programs / "etude-policy").string(), "--checkpoint", checkpoint.string(),
                                           "--run", "examples", "--domain", domain_text},
                                          folder / "policy.log",
                                          {}});
  ASSERT_TRUE(server.has_value()) << server.error().message;
  const auto drive = [&](const char* questions) {
    return RunExample(
        {(programs / "example-robot-driver").string(), "examples", "pick up the red can", domain_text, questions},
        folder / "driver.log");
  };
  // the server loads torch first; the driver holds still until then
  const auto driven = drive("30");
  EXPECT_EQ(driven.exit_code, 0) << driven.text << ReadTextFile(folder / "policy.log").value_or("");

  int answers = 0;
  double last[3] = {0.0, 0.3, 0.2};  // where ExampleRobot begins
  std::istringstream lines(driven.text);
  for (std::string line; std::getline(lines, line);) {
    double p[3], way = 0;
    unsigned long long step = 0;
    if (std::sscanf(line.c_str(), "step %llu of training: hand at %lf %lf %lf", &step, p, p + 1, p + 2) != 4) continue;
    ++answers;
    EXPECT_TRUE(p[0] >= -0.451 && p[0] <= 0.451 && p[1] >= 0.049 && p[1] <= 0.551 && p[2] >= 0.019 && p[2] <= 0.501)
        << line;
    for (int i = 0; i < 3; ++i) way += (p[i] - last[i]) * (p[i] - last[i]);
    EXPECT_LE(way, 0.033 * 0.033) << line;  // 15 steps of 2 mm, and what printing rounds away
    std::copy(p, p + 3, last);
  }
  EXPECT_GE(answers, 3) << driven.text;

  server->Stop(std::chrono::seconds(10));
  const auto alone = drive("1");
  EXPECT_EQ(alone.exit_code, 3);
  EXPECT_NE(alone.text.find("holds still"), std::string::npos) << alone.text;
}

/// The subscriber gets the checkpoint whole.
inline void ExpectSubscriberTakesACheckpoint(const Path& programs, const Path& checkpoint, int domain,
                                             const Path& folder) {
  auto participant = bus::Participant::Open({static_cast<std::uint32_t>(domain), ""});
  ASSERT_TRUE(participant.has_value()) << participant.error().message;
  const std::string id = NewId();
  auto announcement = bus::Announcement::Open(
      *participant, bus::MakePresence(bus::PresenceKind::kRun, "published", id, folder.string()), Claim::kRefuse);
  ASSERT_TRUE(announcement.has_value()) << announcement.error().message;
  auto publisher = bus::BlobPublisher::Open(*participant, {"published", id});
  ASSERT_TRUE(publisher.has_value()) << publisher.error().message;
  const auto bytes = ReadBinaryFile(checkpoint);
  ASSERT_TRUE(bytes.has_value());
  ASSERT_TRUE(publisher->Publish("latest", 7, *bytes, "{}").has_value());

  const auto taken = RunExample({(programs / "example-subscribe").string(), "published", std::to_string(domain), "1"},
                                folder / "subscribe.log");
  EXPECT_EQ(taken.exit_code, 0) << taken.text;
  EXPECT_NE(taken.text.find("version 7"), std::string::npos) << taken.text;
  EXPECT_NE(taken.text.find(Sha256Hex(*bytes)), std::string::npos) << taken.text;
}

}  // namespace etude
