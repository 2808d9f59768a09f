// SPDX-License-Identifier: Apache-2.0
// Tests services/core/progress.cc, and what services/core/log.cc does about it.
#include "services/core/progress.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "services/core/log.h"

namespace etude {
namespace progress_test {

using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

constexpr char kAnew[] = "\r\x1b[K";  // what rewrites a line

// This process's stderr as a terminal of `columns`, for as long as it lives.
class TerminalStderr {
 public:
  explicit TerminalStderr(unsigned short columns = 80) : master_(::posix_openpt(O_RDWR | O_NOCTTY)) {
    EXPECT_EQ(::grantpt(master_), 0);
    EXPECT_EQ(::unlockpt(master_), 0);
    slave_ = ::open(::ptsname(master_), O_RDWR | O_NOCTTY);
    winsize size{};
    size.ws_col = columns;
    size.ws_row = 24;
    EXPECT_EQ(::ioctl(slave_, TIOCSWINSZ, &size), 0);
    kept_ = ::dup(STDERR_FILENO);
    ::dup2(slave_, STDERR_FILENO);
  }
  ~TerminalStderr() {
    ::dup2(kept_, STDERR_FILENO);
    for (const int file : {kept_, slave_, master_}) ::close(file);
  }
  // All that it shows once `last` is among it; what it shows by then where that does not come.
  std::string TextUntil(const std::string& last) {
    pollfd wait{master_, POLLIN, 0};
    while (text_.find(last) == std::string::npos && ::poll(&wait, 1, 10'000) == 1) {
      char bytes[4096];
      const auto count = ::read(master_, bytes, sizeof bytes);
      if (count <= 0) break;
      text_.append(bytes, static_cast<std::size_t>(count));
    }
    return text_;
  }

 private:
  int master_ = -1, slave_ = -1, kept_ = -1;
  std::string text_;
};

TEST(ProgressDisplay, RewritesOneLineOnATerminal) {
  TerminalStderr terminal;
  {
    ProgressDisplay display;
    EXPECT_TRUE(display.in_place());
    display.Show("step 1");
    display.Show("step 2");
    display.Say("kept");
    display.Show("step 3");
  }
  EXPECT_EQ(terminal.TextUntil("step 3\r\n"), std::string("step 1") + kAnew + "step 2" + kAnew + "kept\r\nstep 3\r\n");
}

TEST(ProgressDisplay, LeavesOutWhatATerminalHasNoRoomFor) {
  TerminalStderr terminal(12);
  { ProgressDisplay().Show("0123456789abcdef"); }
  EXPECT_EQ(terminal.TextUntil("\r\n"), "0123456789a\r\n");
}

TEST(ProgressDisplay, WhatIsLoggedTakesThePlaceOfTheLine) {
  InitLog("test", "info");
  TerminalStderr terminal;
  {
    ProgressDisplay display;
    display.Show("step 1");
    Log().debug("not shown");
    Log().info("stage 2 begins");
    display.Show("step 2");
  }
  const std::string text = terminal.TextUntil("step 2\r\n");
  EXPECT_THAT(text, StartsWith(std::string("step 1") + kAnew));
  EXPECT_THAT(text, HasSubstr("stage 2 begins\r\nstep 2\r\n"));
  EXPECT_THAT(text, Not(HasSubstr(std::string(kAnew) + kAnew))) << "what is not shown changes nothing";
}

TEST(ProgressDisplay, LinesStayLinesInAFile) {
  testing::internal::CaptureStderr();
  {
    ProgressDisplay display;
    EXPECT_FALSE(display.in_place());
    EXPECT_TRUE(display.due());
    display.Show("step 1");
    EXPECT_FALSE(display.due()) << "every few seconds";
    display.Say("kept");
    internal::ClearProgress();
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "step 1\nkept\n");
}

TEST(ProgressDisplay, ALogForProgramsHasNoLineBetween) {
  TerminalStderr terminal;
  SetLogFormat(LogFormat::kJson);
  EXPECT_FALSE(ProgressDisplay().in_place());
  SetLogFormat(LogFormat::kText);
}

}  // namespace progress_test
}  // namespace etude
