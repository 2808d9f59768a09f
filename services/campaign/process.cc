// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <iterator>
#include <thread>
#include <utility>

#include "services/core/check.h"
#include "services/core/clock.h"
#include "services/core/service_manager.h"

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
  ::execve(argv[0], argv, environment);
  const int error = errno;
  [[maybe_unused]] const auto written = ::write(report, &error, sizeof error);
  ::_exit(127);
}

}  // namespace

Result<Process> Process::Start(const ProcessOptions& options) {
  ETUDE_CHECK(!options.argv.empty());
  int log = -1;
  if (!options.log.empty()) {
    ETUDE_RETURN_IF_ERROR(MakeFolders(options.log.parent_path()));
    log = ::open(options.log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
    if (log < 0) return Fail(ErrnoError("open the log", options.log, errno));
  }
  auto argv = options.argv;
  auto environment = EnvironmentWith(options.environment);
  const auto argv_pointers = Pointers(argv), environment_pointers = Pointers(environment);
  int report[2];  // closes by itself when exec succeeds
  ETUDE_CHECK(::pipe2(report, O_CLOEXEC) == 0, "errno={}", errno);
  const pid_t parent = ::getpid();
  const pid_t pid = ::fork();
  if (pid == 0) {
    const int output = options.output >= 0 ? options.output : log;
    BecomeProgram(argv_pointers.data(), environment_pointers.data(), {output, options.socket, report[1]}, parent);
  }
  const int fork_error = errno;
  ::close(report[1]);
  if (log >= 0) ::close(log);
  int exec_error = 0;
  if (pid > 0 && ::read(report[0], &exec_error, sizeof exec_error) != sizeof exec_error) exec_error = 0;
  ::close(report[0]);
  if (pid < 0) return Fail(ErrnoError("start", options.argv[0], fork_error));
  Process process(pid);
  if (exec_error != 0) {
    process.Wait(std::chrono::milliseconds(1000));
    return Fail(ErrnoError("start", options.argv[0], exec_error));
  }
  return process;
}

Process::Process(Process&& other) noexcept
    : pid_(std::exchange(other.pid_, -1)), exit_code_(std::exchange(other.exit_code_, std::nullopt)) {}

Process& Process::operator=(Process&& other) noexcept {
  std::swap(pid_, other.pid_);
  std::swap(exit_code_, other.exit_code_);
  return *this;
}

Process::~Process() {
  if (pid_ < 0 || Poll()) return;
  Signal(SIGKILL);
  int status = 0;
  ::waitpid(pid_, &status, 0);
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

int Process::Stop(std::chrono::milliseconds patience) {
  if (pid_ < 0) return 0;
  if (!Poll()) Signal(SIGTERM);
  if (!Wait(patience)) {
    Signal(SIGKILL);
    Wait(std::chrono::milliseconds(5000));
  }
  return exit_code_.value_or(128 + SIGKILL);
}

Path ProgramFolder() {
  std::error_code error;
  const Path self = std::filesystem::read_symlink("/proc/self/exe", error);
  return error ? Path(".") : self.parent_path();
}

Result<Path> FindSibling(const std::string& name) {
  const Path path = ProgramFolder() / name;
  if (::access(path.c_str(), X_OK) == 0) return path;
  return Fail(Code::kUnavailable, fmt::format("start '{}': not found beside this program in {}; build it with "
                                              "`cmake --build --preset release --target {}`",
                                              name, ProgramFolder().string(), name));
}

}  // namespace etude::campaign
