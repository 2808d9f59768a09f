// SPDX-License-Identifier: Apache-2.0
#include "services/core/progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cstdio>

#include "services/core/log.h"
#include "services/core/log_format.h"
#include "services/core/thread_annotations.h"

namespace etude {
namespace {

using namespace std::chrono_literals;

// What stands on the process's terminal.
struct Terminal {
  Mutex mutex;
  bool open ETUDE_GUARDED_BY(mutex) = false;  // a line without its end
};

Terminal& TheTerminal() {
  static auto* const terminal = new Terminal;  // outlives whoever logs at the end, on purpose
  return *terminal;
}

// Writes `text`, over a line that stands open. std::fputs, which throws nothing.
void Write(const std::string& text, bool stays_open) {
  Terminal& terminal = TheTerminal();
  const MutexLock lock(terminal.mutex);
  std::fputs(((terminal.open ? "\r\x1b[K" : "") + text).c_str(), stderr);
  terminal.open = stays_open;
}

std::size_t TerminalWidth() {
  winsize size{};
  if (::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return 120;
  return size.ws_col;
}

}  // namespace

ProgressDisplay::ProgressDisplay() : in_place_(::isatty(STDERR_FILENO) == 1 && GetLogFormat() == LogFormat::kText) {}

ProgressDisplay::~ProgressDisplay() {
  Terminal& terminal = TheTerminal();
  const MutexLock lock(terminal.mutex);
  if (terminal.open) std::fputs("\n", stderr);
  terminal.open = false;
}

bool ProgressDisplay::due() const {
  return MonotonicClock::now() - shown_ >= (in_place_ ? MonotonicClock::duration(300ms) : 5s);
}

void ProgressDisplay::Show(const std::string& line) {
  shown_ = MonotonicClock::now();
  if (GetLogFormat() == LogFormat::kJson)
    Log().info("{}", line);
  else if (in_place_)
    Write(line.substr(0, TerminalWidth() - 1), true);
  else
    Write(line + "\n", false);
}

void ProgressDisplay::Say(const std::string& line) {
  if (GetLogFormat() == LogFormat::kText)
    Write(line + "\n", false);
  else if (!line.empty())
    Log().info("{}", line);
}

namespace internal {
void ClearProgress() { Write("", false); }
}  // namespace internal

}  // namespace etude
