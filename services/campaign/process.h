// SPDX-License-Identifier: Apache-2.0
// A child process: started with its output in a log file, ended with SIGTERM and, where that does not help,
// SIGKILL. A child never outlives the thread that started it.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::campaign {

struct ProcessOptions {
  std::vector<std::string> argv;                   ///< argv[0] is the program's path
  Path log;                                        ///< stdout and stderr are appended; empty: inherited
  std::map<std::string, std::string> environment;  ///< beside the parent's
  int socket = -1;                                 ///< a descriptor that the child has as number 3; -1: none
  int output = -1;                                 ///< instead of `log`: a descriptor for stdout and stderr
};

/// Owns one child in a process group of its own, so that Ctrl-C on the terminal reaches only the parent,
/// which then drains its children. The kernel ends the child when the thread that started it dies: start
/// children from threads that live as long as they should. Not thread-safe.
class Process {
 public:
  /// @error kNotFound, kUnavailable: the program or the log cannot be opened.
  static Result<Process> Start(const ProcessOptions& options);
  Process(Process&& other) noexcept;
  Process& operator=(Process&& other) noexcept;
  /// Ends the child at once (SIGKILL) when it still runs.
  ~Process();

  pid_t pid() const { return pid_; }
  /// Exit code once it has ended, 128 + signal when a signal ended it.
  std::optional<int> Poll();
  bool running() { return !Poll().has_value(); }
  /// Waits at most `timeout`.
  std::optional<int> Wait(std::chrono::milliseconds timeout);
  /// Sends a signal to the child's group.
  void Signal(int signal_number);
  /// SIGTERM, but not a second one: programs of ours take that as an order to end at once instead of draining.
  void Terminate();
  /// Terminate, then SIGKILL after `patience`; returns the exit code.
  int Stop(std::chrono::milliseconds patience);

 private:
  explicit Process(pid_t pid) : pid_(pid) {}
  pid_t pid_ = -1;
  std::optional<int> exit_code_;
  bool terminated_ = false;
};

/// An exit code of Process for people: "signal SIGSEGV (Segmentation fault)", "exit code 1".
std::string HowItEnded(int exit_code);
/// Whether a process with this exit code was ended by a fault of its own: SIGSEGV, SIGABRT and the like.
bool Crashed(int exit_code);
/// Deaths of `children` of a kind without one result after which it is given up to start them again.
int HopelessDeaths(int children);

/// NAME beside this program. @error kUnavailable when it is not there or not executable; says how to build it.
Result<Path> FindSibling(const std::string& name);

}  // namespace etude::campaign
