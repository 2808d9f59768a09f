// SPDX-License-Identifier: Apache-2.0
// Checkpoints outlive their trainer, between real processes: `etude checkpoint relay` and `etude checkpoint watch`, and
// a run that ends or is killed. The program starts itself again as the run.
#include <gtest/gtest.h>
#include <signal.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "services/campaign/process.h"
#include "services/core/stop.h"
#include "services/relay/kept_checkpoints.h"
#include "tests/services/bus/two_processes.h"
#include "tests/services/relay/example_run.h"
#include "tests/support/etude_command.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"

namespace etude {
namespace relay_processes_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 57;
constexpr char kName[] = "outlived";
constexpr char kId[] = "abcd000000000001";

// A run until a stop request: `start` is the first half of its versions, `step` what its checkpoint is of.
int RunTrainer(const char* folder, std::uint64_t start, std::uint64_t step) {
  InstallStopSignals();
  auto participant = bus::Participant::Open({kDomain, ""});
  if (!participant) return std::fprintf(stderr, "%s\n", participant.error().message.c_str()), 1;
  relay::ExampleRun run(*participant, {kName, kId}, folder);
  for (const char* channel : {"latest", "best"})
    run.Publish(relay::ExampleBlob(kId, channel, start << 32 | step, step));
  while (!WaitForStop(1s)) {
  }
  return testing::Test::HasFailure() ? 1 : 0;
}

class RelayProcesses : public ::testing::Test {
 protected:
  // a killed process counts as there for the lease: a short one, but not so short that who waits for a core is gone
  static void SetUpTestSuite() {
    std::string profile = bus::LocalProfileWith("<LeaseDuration>3s</LeaseDuration>");
    const std::string interval = "<SPDPInterval>5s";
    profile.replace(profile.find(interval), interval.size(), "<SPDPInterval>1s");
    ::setenv("CYCLONEDDS_URI", profile.c_str(), 1);
  }
  campaign::Process Start(std::vector<std::string> argv, const std::string& log) {
    auto started = campaign::Process::Start({std::move(argv), folder_ / log, {}});
    EXPECT_TRUE(started) << started.error().message;
    return std::move(*started);
  }
  campaign::Process StartTrainer(std::uint64_t start, std::uint64_t step) {
    return Start({"/proc/self/exe", "run", (folder_ / "run").string(), std::to_string(start), std::to_string(step)},
                 "run.log");
  }
  campaign::Process StartRelay(const std::string& name = kName) {
    return Start({(ProgramsFolder() / "etude").string(), "checkpoint", "relay", "--run", name, "--dir",
                  (folder_ / "relay").string(), "--domain", std::to_string(kDomain)},
                 "relay.log");
  }
  std::string Log(const std::string& log) const { return ReadTextFile(folder_ / log).value_or(""); }
  bool WaitUntilLogHas(const std::string& log, const std::string& text) const {
    return WaitUntil([&] { return Log(log).find(text) != std::string::npos; });
  }
  // What a subscriber gets that knows the run's name and nothing else.
  std::vector<std::uint8_t> Watch(std::uint64_t version, const char* channel = "latest") {
    const Path out = folder_ / ("watched-" + std::to_string(++watched_));
    const auto outcome = RunEtude({"checkpoint", "watch", "--run", kName, "--channel", channel, "--once", "--out",
                                   out.string(), "--domain", std::to_string(kDomain)},
                                  folder_ / "watch.log");
    EXPECT_EQ(outcome.exit_code, 0) << outcome.text << Log("relay.log");
    const std::string name = std::string(channel) + "-" + std::to_string(version) + ".safetensors";
    EXPECT_NE(outcome.text.find(name), std::string::npos) << outcome.text << Log("relay.log");
    return ReadBinaryFile(out / name).value_or(std::vector<std::uint8_t>());
  }

  TemporaryFolder folder_;
  int watched_ = 0;
};

TEST_F(RelayProcesses, ASubscriberThatComesAfterTheRunGetsItsCheckpoint) {
  auto relay = StartRelay();
  {
    auto trainer = StartTrainer(1, 3);
    ASSERT_TRUE(WaitUntilLogHas("relay.log", "channel=latest version=4294967299")) << Log("relay.log");
    ASSERT_TRUE(WaitUntilLogHas("relay.log", "channel=best version=4294967299")) << Log("relay.log");
    EXPECT_EQ(Watch(4294967299), relay::ExampleCheckpoint(3)) << "of the run itself";
    EXPECT_EQ(Log("relay.log").find("is offered"), std::string::npos) << Log("relay.log");
    EXPECT_EQ(trainer.Stop(10s), 0) << Log("run.log");
  }
  EXPECT_EQ(Watch(4294967299), relay::ExampleCheckpoint(3));
  EXPECT_EQ(Watch(4294967299, "best"), relay::ExampleCheckpoint(3));

  // the run goes on: its own are the ones that count from then on
  {
    auto trainer = StartTrainer(2, 8);
    ASSERT_TRUE(WaitUntilLogHas("relay.log", "channel=latest version=8589934600")) << Log("relay.log");
    ASSERT_TRUE(WaitUntilLogHas("relay.log", "the run itself has its newest checkpoint again")) << Log("relay.log");
    EXPECT_EQ(Watch(8589934600), relay::ExampleCheckpoint(8));
    EXPECT_EQ(trainer.Stop(10s), 0) << Log("run.log");
  }
  EXPECT_EQ(relay.Stop(10s), 0) << Log("relay.log");
}

TEST_F(RelayProcesses, ARunThatIsKilledAndARelayThatIsStartedAgainLoseNothing) {
  {
    auto relay = StartRelay();
    auto trainer = StartTrainer(1, 5);
    ASSERT_TRUE(WaitUntilLogHas("relay.log", "channel=latest version=4294967301")) << Log("relay.log");
    trainer.Signal(SIGKILL);
    ASSERT_TRUE(trainer.Wait(10s));
    ASSERT_TRUE(WaitUntilLogHas("relay.log", "is offered")) << Log("relay.log");
    EXPECT_EQ(Watch(4294967301), relay::ExampleCheckpoint(5));
    relay.Signal(SIGKILL);
    ASSERT_TRUE(relay.Wait(10s));
  }
  auto again = StartRelay();
  EXPECT_EQ(Watch(4294967301), relay::ExampleCheckpoint(5));
  EXPECT_EQ(again.Stop(10s), 0) << Log("relay.log");
}

TEST_F(RelayProcesses, AFolderIsOneRelays) {
  const auto holder = relay::KeptCheckpoints::Open(folder_ / "relay", {kName, kId});
  ASSERT_TRUE(holder) << holder.error().message;
  auto relay = StartRelay(std::string(kName) + "@" + kId);
  EXPECT_EQ(relay.Wait(20s), 3) << Log("relay.log");
  EXPECT_NE(Log("relay.log").find("is used by another process"), std::string::npos) << Log("relay.log");
}

}  // namespace relay_processes_test
}  // namespace etude

int main(int argc, char** argv) {
  if (argc == 5 && std::strcmp(argv[1], "run") == 0)
    return etude::relay_processes_test::RunTrainer(argv[2], std::stoull(argv[3]), std::stoull(argv[4]));
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
