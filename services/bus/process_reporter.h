// SPDX-License-Identifier: Apache-2.0
// Tells everyone how this process is, once a second, and what it warns of.
//
//   ETUDE_ASSIGN_OR_RETURN(const auto reporter, ProcessReporter::Start(participant, {.role = "worker"}));
#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "services/bus/messages.h"
#include "services/bus/participant.h"
#include "services/core/file.h"

namespace etude::bus {

struct ReporterOptions {
  std::string role;  ///< worker | collector | trainer | policy | gateway | etude up | ...
  Path folder;       ///< that the process writes to: its disk is what counts; "": the working folder's
  std::chrono::milliseconds every{1000};
};

/// One a process, on a thread of its own; writes what costs nothing to know. What the process logs at warn and above
/// while it lives is published too, the last 64 for late joiners. `participant` must outlive it.
class ProcessReporter {
 public:
  /// @error of the bus
  static Result<std::unique_ptr<ProcessReporter>> Start(const Participant& participant, const ReporterOptions& options);
  /// Says that the process is gone.
  ~ProcessReporter();
  ProcessReporter(const ProcessReporter&) = delete;
  ProcessReporter& operator=(const ProcessReporter&) = delete;

  /// The key of its messages.
  const std::string& process() const;

 private:
  struct Impl;
  explicit ProcessReporter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::bus
