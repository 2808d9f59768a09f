// SPDX-License-Identifier: Apache-2.0
#include "services/cli/progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cstdio>

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

std::size_t TerminalWidth() {
  winsize size{};
  if (::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return 120;
  return size.ws_col;
}

}  // namespace

ProgressDisplay::ProgressDisplay() : terminal_(::isatty(STDERR_FILENO)) {}

ProgressDisplay::~ProgressDisplay() {
  if (open_) std::fputs("\n", stderr);  // unlike fmt::print, it throws nothing
}

bool ProgressDisplay::due() const {
  return MonotonicClock::now() - shown_ >= (terminal_ ? MonotonicClock::duration(300ms) : 5s);
}

void ProgressDisplay::Show(const std::string& line) {
  shown_ = MonotonicClock::now();
  if (!terminal_) {
    fmt::print(stderr, "{}\n", line);
    return;
  }
  fmt::print(stderr, "\r\x1b[K{}", line.substr(0, TerminalWidth() - 1));
  open_ = true;
}

void ProgressDisplay::Say(const std::string& line) {
  fmt::print(stderr, "{}{}\n", open_ ? "\r\x1b[K" : "", line);
  open_ = false;
}

}  // namespace etude::cli
