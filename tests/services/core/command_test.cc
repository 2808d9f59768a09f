// SPDX-License-Identifier: Apache-2.0
// Tests services/core/command.cc; what closes standard output in child processes of their own.
#include "services/core/command.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <pthread.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <tuple>
#include <vector>

#include "services/core/clock.h"
#include "services/core/stop.h"
#include "services/core/stop_reason.h"

namespace etude {
namespace command_test {

using testing::ExitedWithCode;

TEST(Command, ExitCodesFollowTheError) {
  EXPECT_EQ(RunMain("t", [] { return Status(); }), 0);
  EXPECT_EQ(RunMain("t", []() -> Status { return Fail(Code::kInvalidArgument, "usage"); }), 2);
  EXPECT_EQ(RunMain("t", []() -> Status { return Fail(Code::kUnavailable, "no GL"); }), 3);
  EXPECT_EQ(RunMain("t", []() -> Status { return Fail(Code::kCorrupt, "bits"); }), 1);
  EXPECT_EQ(RunMain("t", []() -> Status { throw std::runtime_error("library"); }), 1);
}

TEST(Command, EveryKindOfErrorHasItsExitCodeAndItsWords) {
  for (const auto& [code, exit_code, words] :
       std::initializer_list<std::tuple<Code, int, const char*>>{{Code::kInvalidArgument, 2, "invalid argument"},
                                                                 {Code::kNotFound, 1, "not found"},
                                                                 {Code::kUnavailable, 3, "unavailable"},
                                                                 {Code::kTimeout, 1, "timeout"},
                                                                 {Code::kExhausted, 1, "exhausted"},
                                                                 {Code::kCorrupt, 1, "corrupt"},
                                                                 {Code::kInternal, 1, "internal error"}}) {
    EXPECT_EQ(ExitCodeFor({code, "x"}), exit_code) << words;
    EXPECT_EQ(ToString(code), words);
  }
}

TEST(Command, ABuildsVersionIsTheVersionAndMayNameTheCommit) {
  EXPECT_TRUE(BuildVersion() == Version() || BuildVersion().starts_with(Version() + "+")) << BuildVersion();
  EXPECT_LE(BuildVersion().size(), 64u) << "it fits into a message";
}

TEST(CommandDeathTest, AnExceptionInAThreadEndsTheProgramWithItsWords) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto body = []() -> Status {
    std::thread([] {
      ::pthread_setname_np(::pthread_self(), "loader");
      throw std::runtime_error("no more room");
    }).join();
    return {};
  };
  EXPECT_EXIT(::_exit(RunMain("etude", body)), testing::KilledBySignal(SIGABRT),
              "thread 'loader': unexpected exception: no more room");
}

// What a program says on stderr when its body does this.
std::string Said(const std::function<Status()>& body) {
  testing::internal::CaptureStderr();
  EXPECT_NE(RunMain("etude", body), 0);
  return testing::internal::GetCapturedStderr();
}

TEST(Command, SaysAnErrorOnceUnderItsName) {
  EXPECT_EQ(Said([]() -> Status { return Fail(Code::kCorrupt, "bits"); }), "etude: bits\n");
  EXPECT_EQ(Said([]() -> Status { throw std::runtime_error("library"); }), "etude: unexpected exception: library\n");
  EXPECT_EQ(Said([]() -> Status { throw 5; }),
            "etude: unexpected exception of a library that says nothing about itself\n");
  EXPECT_EQ(Said([]() -> Status { throw std::system_error(std::make_error_code(std::errc::broken_pipe), "a peer"); }),
            "etude: unexpected exception: a peer: Broken pipe\n")
      << "stdout is read: a library's own broken socket is no quiet end";
}

// Ends this process as a program does whose body is this and whose stream goes where `file` goes.
[[noreturn]] void EndWith(int stream, int file, const std::function<Status()>& body) {
  ::dup2(file, stream);
  ::close(file);
  ::_exit(RunMain("etude", body));
}

// The writing end of a pipe that nobody reads.
int UnreadPipe() {
  int ends[2];
  if (::pipe(ends) != 0) ::_exit(99);
  ::close(ends[0]);
  return ends[1];
}

Status PrintMuch() {
  for (int line = 0; line < 100'000; ++line) fmt::print("line {} of many\n", line);
  return Fail(Code::kInternal, "wrote all of it to nobody");
}

TEST(OutputDeathTest, OneThatNobodyReadsEndsTheCommandQuietlyWhereItPrints) {
  EXPECT_EXIT(EndWith(STDOUT_FILENO, UnreadPipe(), PrintMuch), ExitedWithCode(128 + SIGPIPE), "^$");
}

TEST(OutputDeathTest, AFewWordsThatNobodyReadsAreNotDoneEither) {
  const auto print = [] {
    fmt::print("less than a buffer");
    return Status();
  };
  EXPECT_EXIT(EndWith(STDOUT_FILENO, UnreadPipe(), print), ExitedWithCode(kExitUnread), "^$");
}

TEST(OutputDeathTest, WhatTheBodyHoldsIsReleasedBefore) {
  struct Holder {
    ~Holder() { std::fputs("released", stderr); }
  };
  const auto hold = [] {
    const Holder holder;
    return PrintMuch();
  };
  EXPECT_EXIT(EndWith(STDOUT_FILENO, UnreadPipe(), hold), ExitedWithCode(kExitUnread), "^released$");
}

TEST(OutputDeathTest, AnErrorIsAnErrorThoughNobodyReadsStderr) {
  const auto fail = []() -> Status { return Fail(Code::kInvalidArgument, "usage"); };
  EXPECT_EXIT(EndWith(STDERR_FILENO, UnreadPipe(), fail), ExitedWithCode(kExitUsage), "");
}

TEST(OutputDeathTest, AFullDiskIsSaid) {
  const auto print = [] {
    fmt::print("less than a buffer");
    return Status();
  };
  EXPECT_EXIT(EndWith(STDOUT_FILENO, ::open("/dev/full", O_WRONLY), print), ExitedWithCode(kExitMachine),
              "^etude: write 'standard output': No space left on device\n$");
}

TEST(OutputDeathTest, ASocketWhosePeerIsGoneEndsNoService) {
  const auto serve = []() -> Status {
    int ends[2];
    if (::socketpair(AF_UNIX, SOCK_STREAM, 0, ends) != 0) return Fail(Code::kInternal, "no sockets");
    ::close(ends[0]);
    const bool refused = ::write(ends[1], "x", 1) == -1 && errno == EPIPE;
    return refused ? Status() : Fail(Code::kInternal, "the peer was not gone");
  };
  EXPECT_EXIT(::_exit(RunMain("etude", serve)), ExitedWithCode(kExitOk), "^$");
}

TEST(Command, AProgramDoesNotStartAgainWhileThatIsHeldUp) {
  EXPECT_TRUE(MayStartAgain());
  {
    const RestartHold one, other;
    EXPECT_FALSE(MayStartAgain());
  }
  EXPECT_TRUE(MayStartAgain());
}

// Of the host's uptime, which the next program has in common: a wall clock that is set back would keep a process from
// starting again for as long as it was set back by.
TEST(Command, WhenItStartedAgainIsOfNoClockThatPeopleSet) {
  const auto may = [](double started) {
    ::setenv("ETUDE_STARTED_AGAIN", std::to_string(started).c_str(), 1);
    const bool may_start = MayStartAgain();
    ::unsetenv("ETUDE_STARTED_AGAIN");
    return may_start;
  };
  EXPECT_FALSE(may(BootSeconds() - 10));
  EXPECT_TRUE(may(BootSeconds() - kLeastLifeS - 1));
}

// This test's process is started again with the same arguments, and comes here once more.
TEST(Command, AProgramStartsAgainWhereThatIsWanted) {
  if (std::getenv("ETUDE_STARTED_AGAIN") != nullptr) ::_exit(MayStartAgain() ? 43 : 42);
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    RestartWith([] { return std::vector<std::string>{"--gtest_filter=Command.AProgramStartsAgainWhereThatIsWanted"}; });
    ::_exit(RunMain("t", []() -> Status {
      if (!MayStartAgain()) return Fail(Code::kInternal, "it was not started again yet");
      RestartBecause({Code::kTimeout, "lost"});
      return Fail(Code::kTimeout, "stopped while it waited");  // no reason to stay down
    }));
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 42) << "and not a third time before its time";
}

TEST(CommandDeathTest, UnderAServiceManagerAndAfterAStopItEnds) {
  const auto end = [](const char* variable, bool stopped) {
    if (variable) ::setenv(variable, "/nowhere", 1);
    ::_exit(RunMain("t", [stopped]() -> Status {
      if (stopped) RequestStop();
      RestartBecause({Code::kTimeout, "lost"});
      return {};
    }));
  };
  EXPECT_EXIT(end("NOTIFY_SOCKET", false), ExitedWithCode(1), "t: lost");
  EXPECT_EXIT(end(nullptr, true), ExitedWithCode(0), "") << "a stop that was asked for is no failure";
}

}  // namespace command_test
}  // namespace etude
