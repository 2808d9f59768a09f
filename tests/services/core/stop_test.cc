// SPDX-License-Identifier: Apache-2.0
// Tests services/core/stop.cc and stop_reason.cc in child processes, because a stop is for good.
#include "services/core/stop.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <thread>
#include <vector>

#include "services/core/clock.h"
#include "services/core/descriptor.h"
#include "services/core/stop_reason.h"

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

// a dropped ssh session killed a training without its last checkpoint
TEST(StopDeathTest, AHangUpStopsAndASecondOneDoesNotKill) {
  EXPECT_EXIT(
      {
        ::signal(SIGHUP, SIG_DFL);  // whoever runs the tests may ignore it
        InstallStopSignals();
        ::raise(SIGHUP);
        ::raise(SIGHUP);
        ::_exit(StopRequested() ? 0 : 1);
      },
      ::testing::ExitedWithCode(0), "");
}

TEST(StopDeathTest, AHangUpThatIsIgnoredStaysSo) {
  EXPECT_EXIT(
      {
        ::signal(SIGHUP, SIG_IGN);  // nohup
        InstallStopSignals();
        ::raise(SIGHUP);
        ::_exit(StopRequested() ? 1 : 0);
      },
      ::testing::ExitedWithCode(0), "");
}

// what is printed while stopping would be an error of the terminal that has gone, and end the stop
TEST(StopDeathTest, AfterAHangUpTheTerminalIsNotWrittenTo) {
  const Descriptor probe(::posix_openpt(O_RDWR | O_NOCTTY));
  if (!probe || ::unlockpt(probe.get()) != 0 || !Descriptor(::open(::ptsname(probe.get()), O_RDWR | O_NOCTTY)))
    GTEST_SKIP() << "no pseudo-terminals here";
  EXPECT_EXIT(
      {
        const int master = ::posix_openpt(O_RDWR | O_NOCTTY);
        const bool made = master >= 0 && ::grantpt(master) == 0 && ::unlockpt(master) == 0;
        const int terminal = made ? ::open(::ptsname(master), O_RDWR | O_NOCTTY) : -1;
        ::dup2(terminal, STDOUT_FILENO);
        ::signal(SIGHUP, SIG_DFL);
        InstallStopSignals();
        ::close(master);  // hangs up: writing is EIO from here on
        const bool gone = ::write(STDOUT_FILENO, "a", 1) == -1 && errno == EIO;
        ::raise(SIGHUP);
        ::_exit(terminal >= 0 && gone && ::write(STDOUT_FILENO, "a", 1) == 1 ? 0 : 1);
      },
      ::testing::ExitedWithCode(0), "");
}

// a limit on files, as batch systems set one, ended the process without words
TEST(StopDeathTest, AFileBeyondTheLimitIsAnErrorOfTheWrite) {
  EXPECT_EXIT(
      {
        InstallStopSignals();
        rlimit limit;
        limit.rlim_cur = limit.rlim_max = 1;
        const bool set = ::setrlimit(RLIMIT_FSIZE, &limit) == 0;
        const Descriptor file(::memfd_create("stop_test", MFD_CLOEXEC));
        const bool first = ::write(file.get(), "ab", 2) == 1;
        ::_exit(set && first && ::write(file.get(), "b", 1) == -1 && errno == EFBIG ? 0 : 1);
      },
      ::testing::ExitedWithCode(0), "");
}

TEST(StopReasonDeathTest, TheFirstReasonCountsAndEndsEveryWait) {
  EXPECT_EXIT(
      {
        const bool none = !ReasonOfStop().has_value() && !StopRequested();
        StopBecause({Code::kUnavailable, "the disk is gone"});
        StopBecause({Code::kInternal, "and so is all that needs it"});
        const auto reason = ReasonOfStop();
        const bool first = reason && reason->code == Code::kUnavailable && reason->message == "the disk is gone";
        ::_exit(none && first && WaitForStop(60s) ? 0 : 1);
      },
      ::testing::ExitedWithCode(0), "");
}

TEST(StopReasonDeathTest, ASignalHasNone) {
  EXPECT_EXIT(
      {
        InstallStopSignals();
        ::raise(SIGTERM);
        ::_exit(StopRequested() && !ReasonOfStop() ? 0 : 1);
      },
      ::testing::ExitedWithCode(0), "");
}

TEST(StopReasonDeathTest, ThreadsThatFailTogetherLeaveOneReasonOfTheirs) {
  EXPECT_EXIT(
      {
        std::vector<std::thread> threads;
        for (int i = 0; i < 8; ++i)
          threads.emplace_back([i] { StopBecause({Code::kInternal, "thread " + std::to_string(i)}); });
        for (auto& thread : threads) thread.join();
        const auto reason = ReasonOfStop();
        ::_exit(reason && reason->message.starts_with("thread ") && StopRequested() ? 0 : 1);
      },
      ::testing::ExitedWithCode(0), "");
}

TEST(Stop, WaitingTimesOutWithoutOne) { EXPECT_FALSE(WaitForStop(1ms)); }

// before, progress went into the file that was written, and a stop pipe that said what it was told woke for ever
TEST(StopDeathTest, WhatIsPrintedToAClosedStreamGoesIntoNoFileOfOurs) {
  const auto body = [] {
    ::signal(SIGHUP, SIG_IGN);  // nohup
    for (int fd = 0; fd <= STDERR_FILENO; ++fd) ::close(fd);
    InstallStopSignals();
    const int file = ::open("/proc/self/status", O_RDONLY);
    [[maybe_unused]] const auto written = ::write(STDERR_FILENO, "x", 1);
    const Stopwatch watch;
    WaitForStop(std::chrono::milliseconds(50));
    ::_exit(file > STDERR_FILENO && watch.Seconds() > 0.04 ? 0 : 1);
  };
  EXPECT_EXIT(body(), ::testing::ExitedWithCode(0), "");
}

}  // namespace stop_test
}  // namespace etude
