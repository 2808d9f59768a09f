// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/process.cc
#include "services/campaign/process.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <cstdlib>

#include "services/core/descriptor.h"
#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace process_test {

using namespace std::chrono_literals;

TEST(Process, GivesTheExitCode) {
  auto process = Process::Start({{"/bin/sh", "-c", "exit 7"}, {}, {}});
  ASSERT_TRUE(process) << process.error().message;
  EXPECT_EQ(process->Wait(10s), 7);
  EXPECT_EQ(process->Wait(0s), 7) << "and keeps it";
}

TEST(Process, WritesItsOutputIntoTheLogWithTheGivenEnvironment) {
  TemporaryFolder folder;
  auto process =
      Process::Start({{"/bin/sh", "-c", "echo out $WORD; echo err >&2"}, folder / "logs/a.log", {{"WORD", "etude"}}});
  ASSERT_TRUE(process) << process.error().message;
  EXPECT_EQ(process->Wait(10s), 0);
  EXPECT_EQ(ReadTextFile(folder / "logs/a.log").value(), "out etude\nerr\n");
}

TEST(Process, DoesNotHandOnTheServiceManagersAddress) {
  TemporaryFolder folder;
  ::setenv("NOTIFY_SOCKET", "/run/notify", 1);
  auto process = Process::Start({{"/bin/sh", "-c", "echo \"[$NOTIFY_SOCKET]\""}, folder / "log", {}});
  ::unsetenv("NOTIFY_SOCKET");
  ASSERT_TRUE(process) << process.error().message;
  EXPECT_EQ(process->Wait(10s), 0);
  EXPECT_EQ(ReadTextFile(folder / "log").value(), "[]\n");
}

TEST(Process, ReportsAProgramThatIsNotThere) {
  const auto process = Process::Start({{"/no/such/program"}, {}, {}});
  ASSERT_FALSE(process);
  EXPECT_NE(process.error().message.find("/no/such/program"), std::string::npos);
}

TEST(Process, StopEndsAChildThatIgnoresSigterm) {
  TemporaryFolder folder;
  auto process =
      Process::Start({{"/bin/sh", "-c", "trap '' TERM; echo ready; while :; do sleep 0.05; done"}, folder / "log", {}});
  ASSERT_TRUE(process);
  while (ReadTextFile(folder / "log").value_or("") != "ready\n") process->Wait(5ms);
  EXPECT_EQ(process->Stop(100ms), 128 + SIGKILL);
}

TEST(Process, IsTerminatedOnceWhoeverOwnsIt) {
  TemporaryFolder folder;
  // the second SIGTERM, as with our programs, ends it without its last word
  constexpr char kScript[] =
      "trap 'trap \"exit 1\" TERM; sleep 1; echo drained; exit 0' TERM; echo ready; while :; do sleep 0.05; done";
  auto process = Process::Start({{"/bin/sh", "-c", kScript}, folder / "log", {}});
  ASSERT_TRUE(process);
  while (ReadTextFile(folder / "log").value_or("") != "ready\n") process->Wait(5ms);
  process->Terminate();
  Process moved = std::move(*process);
  moved.Terminate();
  *process = std::move(moved);
  EXPECT_EQ(process->Stop(30s), 0);
  // the shell may also tell of the pause that the signal cut off
  EXPECT_THAT(ReadTextFile(folder / "log").value(), testing::EndsWith("drained\n"));
}

TEST(Process, DoesNotHandOnItsDescriptors) {
  TemporaryFolder folder;
  const Descriptor ours(::open("/dev/null", O_RDONLY));  // as libraries open sockets: without O_CLOEXEC
  ASSERT_TRUE(ours);
  const std::string script = "[ -e /proc/self/fd/" + std::to_string(ours.get()) + " ] && echo open || echo closed";
  auto process = Process::Start({{"/bin/sh", "-c", script}, folder / "log", {}});
  ASSERT_TRUE(process) << process.error().message;
  EXPECT_EQ(process->Wait(10s), 0);
  EXPECT_EQ(ReadTextFile(folder / "log").value(), "closed\n");
}

TEST(Process, IsEndedWithItsOwner) {
  pid_t pid = 0;
  {
    auto process = Process::Start({{"/bin/sh", "-c", "sleep 1000"}, {}, {}});
    ASSERT_TRUE(process);
    pid = process->pid();
    EXPECT_TRUE(process->running());
  }
  EXPECT_EQ(::kill(pid, 0), -1);
}

TEST(FindSibling, SaysHowToBuildWhatIsMissing) {
  const auto sibling = FindSibling("etude-no-such-program");
  ASSERT_FALSE(sibling);
  EXPECT_EQ(sibling.error().code, Code::kUnavailable);
  EXPECT_NE(sibling.error().message.find("cmake --build"), std::string::npos);
}

}  // namespace process_test
}  // namespace etude::campaign
