// SPDX-License-Identifier: Apache-2.0
// Tests services/core/service_manager.cc against a NOTIFY_SOCKET of the test's own.
#include "services/core/service_manager.h"

#include <gmock/gmock.h>
#include <unistd.h>

#include <cstdlib>

#include "tests/support/notify_socket.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace service_manager_test {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST(ServiceManager, SaysItsStatesInOrderAndTheGreatOnesOnce) {
  const TemporaryFolder folder;
  NotifySocket socket(folder / "notify");
  ServiceManager manager({.socket = socket.name()});
  manager.Ready("campaign a\nwith 2 workers");
  manager.Ready("again");
  manager.Say("committed 1");
  manager.Stopping();
  manager.Stopping();
  EXPECT_THAT(socket.Take(),
              ElementsAre("READY=1\nSTATUS=campaign a with 2 workers", "STATUS=committed 1", "STOPPING=1"));
}

TEST(ServiceManager, SpeaksToAnAbstractSocket) {
  NotifySocket socket("@etude-notify-" + std::to_string(::getpid()));
  ServiceManager manager({.socket = socket.name()});
  manager.Ready("up");
  EXPECT_THAT(socket.Take(), ElementsAre("READY=1\nSTATUS=up"));
}

TEST(ServiceManager, SendsAStatusOnceASecondAndNotTheSameAgain) {
  const TemporaryFolder folder;
  NotifySocket socket(folder / "notify");
  ServiceManager manager({.socket = socket.name()});
  for (int i = 0; i < 100; ++i) manager.Say("step " + std::to_string(i / 50));
  EXPECT_THAT(socket.Take(), ElementsAre("STATUS=step 0"));
}

TEST(ServiceManager, WhatWasNeverReadyDoesNotStop) {
  const TemporaryFolder folder;
  NotifySocket socket(folder / "notify");
  ServiceManager manager({.socket = socket.name()});
  manager.Stopping();
  EXPECT_THAT(socket.Take(), IsEmpty());
}

TEST(ServiceManager, ASocketThatIsNotThereHarmsNobody) {
  for (const char* name : {"", "relative", "/nowhere/at/all"}) {
    ServiceManager manager({.socket = name, .watchdog = 1s});
    WatchedLoop loop(manager);
    manager.Ready("up");
    manager.Say("at work");
    loop.Moved();
    manager.Stopping();
  }
}

class WatchdogTest : public ::testing::Test {
 protected:
  const TemporaryFolder folder_;
  NotifySocket socket_{folder_ / "notify"};
  ServiceManager manager_{{.socket = socket_.name(), .watchdog = 8s}};
  const MonotonicClock::time_point start_ = MonotonicClock::now();
};

TEST_F(WatchdogTest, IsFedFourTimesAnInterval) {
  WatchedLoop loop(manager_);
  for (auto now = start_; now < start_ + 8s; now += 100ms) loop.Moved(now);
  EXPECT_THAT(socket_.Take(), ElementsAre("WATCHDOG=1", "WATCHDOG=1", "WATCHDOG=1", "WATCHDOG=1"));
}

TEST_F(WatchdogTest, IsNotFedByALoopWhileAnotherHangs) {
  WatchedLoop moving(manager_), hanging(manager_);
  hanging.Moved(start_);
  (void)socket_.Take();
  for (auto now = start_ + 4s; now < start_ + 60s; now += 100ms) moving.Moved(now);
  EXPECT_THAT(socket_.Take(), IsEmpty());
  hanging.Moved(start_ + 60s);
  EXPECT_THAT(socket_.Take(), ElementsAre("WATCHDOG=1"));
}

TEST_F(WatchdogTest, IsFedAgainOnceTheLoopThatHungHasEnded) {
  WatchedLoop moving(manager_);
  { const WatchedLoop ended(manager_); }
  moving.Moved(start_ + 60s);
  EXPECT_THAT(socket_.Take(), ElementsAre("WATCHDOG=1"));
}

TEST(ServiceManager, NeedsAWatchdogToFeedOne) {
  const TemporaryFolder folder;
  NotifySocket socket(folder / "notify");
  ServiceManager manager({.socket = socket.name()});
  WatchedLoop loop(manager);
  loop.Moved(MonotonicClock::now() + 60s);
  EXPECT_THAT(socket.Take(), IsEmpty());
}

TEST(ServiceManagerEnvironment, AWatchdogOfAnotherProcessIsNotOurs) {
  ::setenv("NOTIFY_SOCKET", "/run/notify", 1);
  ::setenv("WATCHDOG_USEC", "30000000", 1);
  ::setenv("WATCHDOG_PID", std::to_string(::getpid()).c_str(), 1);
  EXPECT_EQ(ServiceManager::FromEnvironment().watchdog, 30s);
  EXPECT_EQ(ServiceManager::FromEnvironment().socket, "/run/notify");
  ::setenv("WATCHDOG_PID", "1", 1);
  EXPECT_EQ(ServiceManager::FromEnvironment().watchdog, 0s);
  for (const char* variable : ServiceManager::kVariables) ::unsetenv(variable);
}

}  // namespace service_manager_test
}  // namespace etude
