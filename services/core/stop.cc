// SPDX-License-Identifier: Apache-2.0
#include "services/core/stop.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>

#include "services/core/check.h"

namespace etude {
namespace {

std::atomic<bool> stop_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free);

// a pipe that becomes readable with the stop, so that waiting needs no polling interval
int* StopPipe() {
  static int fds[2] = {-1, -1};
  static const bool opened = [] {
    ETUDE_CHECK(::pipe2(fds, O_CLOEXEC | O_NONBLOCK) == 0, "errno={}", errno);
    return true;
  }();
  (void)opened;
  return fds;
}

void OnSignal(int signal_number) {
  if (stop_requested.load()) {
    ::signal(signal_number, SIG_DFL);
    ::raise(signal_number);
    return;
  }
  RequestStop();
}

int nowhere = -1;          // /dev/null
bool on_terminal[3] = {};  // standard input, output, error
static_assert(STDERR_FILENO == 2);

// The terminal has gone, a dropped ssh session's say: what is still said while stopping must not fail for that. Shell
// and kernel may both say so: a second one does not kill.
void OnHangUp(int) {
  const int saved_errno = errno;
  for (int fd = 0; fd < 3; ++fd)
    if (on_terminal[fd] && nowhere >= 0) ::dup2(nowhere, fd);
  errno = saved_errno;
  RequestStop();
}

// Where it is ignored (nohup), it stays so.
void InstallHangUp() {
  struct sigaction before {};
  ::sigaction(SIGHUP, nullptr, &before);
  if (before.sa_handler == SIG_IGN) return;
  if (nowhere < 0) nowhere = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  for (int fd = 0; fd < 3; ++fd) on_terminal[fd] = ::isatty(fd) == 1;
  struct sigaction action {};
  action.sa_handler = OnHangUp;
  ::sigaction(SIGHUP, &action, nullptr);
}

// Of a stream that was closed (`>&- 2>&-`) the next file that is opened would have the number, and what is printed.
// This one takes no words, as a closed one.
void OpenClosedStreams() {
  int fd = -1;
  do fd = ::open("/dev/null", O_RDONLY);
  while (fd >= 0 && fd <= STDERR_FILENO);
  if (fd >= 0) ::close(fd);
}

}  // namespace

void InstallStopSignals() {
  OpenClosedStreams();  // before anything else is opened
  StopPipe();
  struct sigaction action {};
  action.sa_handler = OnSignal;
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
  InstallHangUp();
  ::signal(SIGPIPE, SIG_IGN);
  ::signal(SIGCHLD, SIG_DFL);  // where the parent ignores it, that is inherited, and children end without a word
  ::signal(SIGXFSZ, SIG_IGN);  // the write then says EFBIG, which is waited out like a full disk
}

bool StopRequested() { return stop_requested.load(std::memory_order_relaxed); }

void RequestStop() {
  const int saved_errno = errno;
  stop_requested.store(true);
  const char byte = 1;
  // a full pipe is already readable
  [[maybe_unused]] const auto written = ::write(StopPipe()[1], &byte, 1);
  errno = saved_errno;
}

bool WaitForStop(std::chrono::nanoseconds timeout) {
  if (StopRequested()) return true;
  pollfd readable{StopPipe()[0], POLLIN, 0};
  const auto ns = timeout.count();
  const timespec duration{ns / 1'000'000'000, ns % 1'000'000'000};
  ::ppoll(&readable, 1, &duration, nullptr);
  return StopRequested();
}

}  // namespace etude
