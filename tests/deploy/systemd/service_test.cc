// SPDX-License-Identifier: Apache-2.0
// What our services say to a service manager while they start, work and stop.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include "services/campaign/process.h"
#include "tests/support/etude_command.h"
#include "tests/support/matchers.h"
#include "tests/support/notify_socket.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace service_test {

using namespace std::chrono_literals;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

constexpr auto kPatience = 30s;

class ServiceTest : public ::testing::Test {
 protected:
  // As systemd starts it; from a shell, because children of ours are not given such variables.
  void Start(std::vector<std::string> arguments) {
    arguments[0] = (ProgramsFolder() / arguments[0]).string();
    arguments.insert(arguments.end(), {"--domain", "104"});
    // the shell becomes the program, which keeps its process id
    std::vector<std::string> argv{
        "/bin/sh", "-c",
        "export NOTIFY_SOCKET=" + socket_.name() + " WATCHDOG_USEC=1000000 WATCHDOG_PID=$$; exec \"$@\"", "sh"};
    argv.insert(argv.end(), arguments.begin(), arguments.end());
    auto process = campaign::Process::Start({argv, folder_ / "log", {}});
    ASSERT_THAT(process, IsOk());
    process_.emplace(std::move(*process));
  }
  std::string LogText() const { return ReadTextFile(folder_ / "log").value_or(""); }

  // Ready first, then signs of life for as long as it has nothing to do, then the word that it stops.
  void ExpectAWholeLife(const std::string& status) {
    const auto ready = socket_.WaitFor("READY=1", kPatience);
    ASSERT_THAT(ready.back(), StartsWith("READY=1\nSTATUS=")) << LogText();
    EXPECT_THAT(ready.back(), HasSubstr(status));
    for (int i = 0; i < 4; ++i) ASSERT_EQ(socket_.WaitFor("WATCHDOG=1", kPatience).back(), "WATCHDOG=1") << LogText();
    process_->Signal(SIGTERM);
    EXPECT_EQ(socket_.WaitFor("STOPPING=1", kPatience).back(), "STOPPING=1") << LogText();
    EXPECT_EQ(process_->Wait(kPatience), 0) << LogText();
  }

  const TemporaryFolder folder_;
  NotifySocket socket_{folder_ / "notify"};
  std::optional<campaign::Process> process_;
};

TEST_F(ServiceTest, ACollector) {
  Start(
      {"etude-collector", "deploy/campaigns/quickstart.yaml", "--out", (folder_ / "data").string(), "--episodes", "2"});
  ExpectAWholeLife("campaign quickstart@");
}

TEST_F(ServiceTest, AWorkerThatWaitsForItsCampaign) {
  Start({"etude-worker", "--campaign", "nobodys"});
  ExpectAWholeLife("campaign nobodys");
}

TEST_F(ServiceTest, AWorkerWithSlots) {
  Start({"etude-worker", "--campaign", "nobodys", "--slots", "1"});
  ExpectAWholeLife("campaign nobodys");
}

TEST_F(ServiceTest, ATrainerThatWaitsForItsData) {
  Start({"etude-trainer", "--data", (folder_ / "data").string(), "--follow", "--out", (folder_ / "run").string(),
         "--config", "compact", "--name", "early", "--steps", "10"});
  ExpectAWholeLife("run early@");
}

TEST_F(ServiceTest, APolicyServerThatWaitsForItsRun) {
  Start({"etude-policy", "--subscribe", "nobodys", "--relay", (folder_ / "relay").string()});
  ExpectAWholeLife("run nobodys");
}

TEST_F(ServiceTest, AGateway) {
  Start({"etude-gateway", "--dir", folder_.path().string(), "--port", "0", "--no-bus"});
  ExpectAWholeLife("http://127.0.0.1:");
}

// A process whose threads live but whose loop hangs is not alive: it is stopped in the middle of its work.
TEST_F(ServiceTest, WhatIsSuspendedFeedsNoWatchdog) {
  Start({"etude-worker", "--campaign", "nobodys"});
  ASSERT_EQ(socket_.WaitFor("WATCHDOG=1", kPatience).back(), "WATCHDOG=1") << LogText();
  process_->Signal(SIGSTOP);
  (void)socket_.WaitFor("STATUS", 200ms);  // what was on its way
  EXPECT_THAT(socket_.WaitFor("WATCHDOG=1", 1500ms), Not(Contains("WATCHDOG=1")));
  process_->Signal(SIGCONT);
  EXPECT_EQ(socket_.WaitFor("WATCHDOG=1", kPatience).back(), "WATCHDOG=1");
}

TEST_F(ServiceTest, AWrongArgumentIsNeverReady) {
  Start({"etude-collector", "deploy/campaigns/none.yaml", "--out", (folder_ / "data").string()});
  EXPECT_EQ(process_->Wait(kPatience), 2) << LogText();
  EXPECT_THAT(socket_.Take(), Not(Contains(HasSubstr("READY"))));
}

}  // namespace service_test
}  // namespace etude
