// SPDX-License-Identifier: Apache-2.0
// Tests services/core/stop.cc in child processes, because a stop is for good.
#include "services/core/stop.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include "services/core/clock.h"

namespace etude {
namespace stop_test {

using namespace std::chrono_literals;

TEST(StopDeathTest, ASignalEndsAWaitAtOnce) {
  EXPECT_EXIT(
      {
        InstallStopSignals();
        ::kill(::getpid(), SIGTERM);
        const Stopwatch watch;
        const bool stopped = WaitForStop(60s);
        ::_exit(stopped && watch.Seconds() < 30 ? 0 : 1);
      },
      ::testing::ExitedWithCode(0), "");
}

TEST(StopDeathTest, ASecondSignalKills) {
  EXPECT_EXIT(
      {
        InstallStopSignals();
        ::raise(SIGINT);
        ::raise(SIGINT);
        ::_exit(0);
      },
      ::testing::KilledBySignal(SIGINT), "");
}

TEST(Stop, WaitingTimesOutWithoutOne) { EXPECT_FALSE(WaitForStop(1ms)); }

}  // namespace stop_test
}  // namespace etude
