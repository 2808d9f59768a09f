// SPDX-License-Identifier: Apache-2.0
// A supervised child that is not a worker: trainer or policy server.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "services/campaign/process.h"
#include "services/core/clock.h"
#include "services/core/result.h"

namespace etude::cli {

struct ServiceOptions {
  std::string program;  ///< a sibling: etude-trainer
  std::vector<std::string> arguments;
  std::vector<std::string> restart_arguments;  ///< appended when it is started again: --resume
  /// Without this file there is nothing to go on with, and restart_arguments are left out; "": they never are.
  Path restart_needs;
  std::map<std::string, std::string> environment;
  Path log;              ///< "": it speaks where this program does
  int max_restarts = 5;  ///< in quick succession: a life of ten minutes wipes out what was before
  /// A server: when it ends by itself with exit code 0, told to by hand, it is not done but started again.
  bool lasting = false;
};

/// One child, started again when it dies of something that may pass.
class Service {
 public:
  static Result<Service> Start(const ServiceOptions& options);
  /// Call a few times a second. @error when it ended with exit code 2 or 3, or too often; the message has the
  /// log's last lines.
  Status Supervise();
  /// It ended by itself with exit code 0.
  bool done() const { return done_; }
  void Stop(std::chrono::milliseconds patience);
  /// Of the child that is there now.
  std::optional<pid_t> pid() const { return process_ ? std::optional(process_->pid()) : std::nullopt; }

 private:
  explicit Service(ServiceOptions options) : options_(std::move(options)) {}
  Status Launch();

  ServiceOptions options_;
  std::optional<campaign::Process> process_;
  MonotonicClock::time_point start_again_{};
  Stopwatch since_launch_;
  int restarts_ = 0, deaths_ = 0;  ///< in all; in quick succession
  int brief_lives_ = 0;            ///< in a row, of a lasting one
  bool done_ = false;
};

}  // namespace etude::cli
