// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/close_range.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <iterator>
#include <thread>
#include <utility>

#include "services/core/check.h"
#include "services/core/clock.h"
#include "services/core/descriptor.h"
#include "services/core/service_manager.h"
#include "services/core/share.h"

extern char** environ;

namespace etude::campaign {
namespace {

std::vector<std::string> EnvironmentWith(const std::map<std::string, std::string>& extra) {
  std::vector<std::string> result;
  for (char** entry = environ; *entry; ++entry) {
    const std::string text = *entry;
    const std::string key = text.substr(0, text.find('='));
    // a child that has the service manager's address would speak in this process's name
    const bool is_mine = std::ranges::find(ServiceManager::kVariables, key) != std::end(ServiceManager::kVariables);
    if (!is_mine && !extra.contains(key)) result.push_back(text);
  }
  for (const auto& [key, value] : extra) result.push_back(key + "=" + value);
  return result;
}

std::vector<char*> Pointers(std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  for (auto& text : texts) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

// What the child gets of the parent's descriptors; -1: none.
struct ProcessDescriptors {
  int output, socket, report;
};

// In the child between fork and exec: only what is safe after a fork of a process with threads.
[[noreturn]] void BecomeProgram(char* const* argv, char* const* environment, const ProcessDescriptors& descriptors,
                                pid_t parent) {
  ::setpgid(0, 0);
  ::prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (::getppid() != parent) ::_exit(127);  // it died before prctl
  sigset_t none;
  ::sigemptyset(&none);
  ::sigprocmask(SIG_SETMASK, &none, nullptr);
  ::signal(SIGPIPE, SIG_DFL);
  const int null = ::open("/dev/null", O_RDONLY);
  if (null >= 0) ::dup2(null, 0);
  if (descriptors.output >= 0) {
    ::dup2(descriptors.output, 1);
    ::dup2(descriptors.output, 2);
  }
  int report = descriptors.report;
  if (descriptors.socket >= 0) {
    // number 3 may be taken by what is still needed
    if (report == 3) report = ::fcntl(report, F_DUPFD_CLOEXEC, 4);
    if (descriptors.socket == 3)
      ::fcntl(3, F_SETFD, 0);
    else
      ::dup2(descriptors.socket, 3);
  }
  // libraries open sockets without the flag: a child that held them would keep ports of ours taken. A kernel that does
  // not know this call hands them on, as before
  const unsigned from = descriptors.socket >= 0 ? 4 : 3;
  ::close_range(from, ~0U, CLOSE_RANGE_CLOEXEC);
  ::execve(argv[0], argv, environment);
  const int error = errno;
  [[maybe_unused]] const auto written = ::write(report, &error, sizeof error);
  ::_exit(127);
}

// What the child reports through `report` before it ends; 0 once exec has closed the pipe.
int ReadExecError(int report) {
  int error = 0;
  ssize_t got = 0;
  do got = ::read(report, &error, sizeof error);
  while (got < 0 && errno == EINTR);
  return got == sizeof error ? error : 0;
}

}  // namespace

Result<Process> Process::Start(const ProcessOptions& options) {
  ETUDE_CHECK(!options.argv.empty());
  Descriptor log;
  if (!options.log.empty()) {
    ETUDE_RETURN_IF_ERROR(MakeFolders(options.log.parent_path()));
    log.reset(::open(options.log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644));
    if (!log) return Fail(ErrnoError("open the log", options.log, errno));
  }
  auto argv = options.argv;
  auto environment = EnvironmentWith(options.environment);
  const auto argv_pointers = Pointers(argv), environment_pointers = Pointers(environment);
  int report[2];  // closes by itself when exec succeeds
  if (::pipe2(report, O_CLOEXEC) != 0) return Fail(ErrnoError("make a pipe to start", options.argv[0], errno));
  const Descriptor reported(report[0]);
  Descriptor to_report(report[1]);
  const pid_t parent = ::getpid();
  const pid_t pid = ::fork();
  if (pid == 0) {
    const int output = options.output >= 0 ? options.output : log.get();
    BecomeProgram(argv_pointers.data(), environment_pointers.data(), {output, options.socket, to_report.get()}, parent);
  }
  const int fork_error = errno;
  to_report.reset();
  if (pid < 0) return Fail(ErrnoError("start", options.argv[0], fork_error));
  const int exec_error = ReadExecError(reported.get());
  Process process(pid);
  if (exec_error != 0) {
    process.Wait(std::chrono::milliseconds(1000));
    return Fail(ErrnoError("start", options.argv[0], exec_error));
  }
  return process;
}

Process::Process(Process&& other) noexcept
    : pid_(std::exchange(other.pid_, -1)),
      exit_code_(std::exchange(other.exit_code_, std::nullopt)),
      terminated_(std::exchange(other.terminated_, false)) {}

Process& Process::operator=(Process&& other) noexcept {
  std::swap(pid_, other.pid_);
  std::swap(exit_code_, other.exit_code_);
  std::swap(terminated_, other.terminated_);
  return *this;
}

Process::~Process() {
  if (pid_ < 0 || Poll()) return;
  Signal(SIGKILL);
  int status = 0;
  while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
  }
}

std::optional<int> Process::Poll() {
  if (exit_code_ || pid_ < 0) return exit_code_;
  int status = 0;
  const pid_t ended = ::waitpid(pid_, &status, WNOHANG);
  if (ended != pid_) return std::nullopt;
  exit_code_ = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
  return exit_code_;
}

std::optional<int> Process::Wait(std::chrono::milliseconds timeout) {
  const auto deadline = MonotonicClock::now() + timeout;
  while (!Poll() && MonotonicClock::now() < deadline) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  return Poll();
}

void Process::Signal(int signal_number) {
  if (pid_ > 0 && !exit_code_) ::kill(-pid_, signal_number);
}

void Process::Terminate() {
  if (!std::exchange(terminated_, true)) Signal(SIGTERM);
}

int Process::Stop(std::chrono::milliseconds patience) {
  if (pid_ < 0) return 0;
  if (!Poll()) Terminate();
  if (!Wait(patience)) {
    Signal(SIGKILL);
    Wait(std::chrono::milliseconds(5000));
  }
  return exit_code_.value_or(128 + SIGKILL);
}

std::string HowItEnded(int exit_code) {
  const int signal_number = exit_code - 128;
  const char* name = signal_number > 0 ? ::sigabbrev_np(signal_number) : nullptr;
  if (!name) return fmt::format("exit code {}", exit_code);
  return fmt::format("signal SIG{} ({})", name, ::sigdescr_np(signal_number));
}

bool Crashed(int exit_code) {
  constexpr std::array kFaults{SIGSEGV, SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGTRAP};
  return std::ranges::find(kFaults, exit_code - 128) != kFaults.end();
}

int HopelessDeaths(int children) { return std::max(6, 3 * children); }

Result<Path> FindSibling(const std::string& name) {
  const Path path = ProgramFolder() / name;
  if (::access(path.c_str(), X_OK) == 0) return path;
  return Fail(Code::kUnavailable, fmt::format("start '{}': not found beside this program in {}; build it with "
                                              "`cmake --build --preset release --target {}`",
                                              name, ProgramFolder().string(), name));
}

}  // namespace etude::campaign
