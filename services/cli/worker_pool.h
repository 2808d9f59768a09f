// SPDX-License-Identifier: Apache-2.0
// N local worker processes, supervised: restarted with back-off when they die.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "services/campaign/process.h"
#include "services/cli/command_line.h"
#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::cli {

struct WorkerPoolOptions {
  int workers = 1;
  std::string campaign;  ///< NAME@ID
  BusArguments bus;
  Path logs;  ///< LOGS/worker-0.log, ...
  /// Told the bus name of a worker that has ended, and its exit code, so that its lease is free at once.
  std::function<void(const std::string&, int)> on_end;
  /// Episodes committed and attempts failed so far: workers that die are started again for as long as this grows.
  std::function<std::uint64_t()> done;
  /// Workers that lost their leases because they were silent or did not move: they are ended and started again.
  std::function<std::vector<std::string>()> silent = nullptr;
  Path program;  ///< empty: the sibling etude-worker
};

/// Owns the processes. Use from one thread that outlives it (children end with the thread that made them).
class WorkerPool {
 public:
  static Result<WorkerPool> Start(const WorkerPoolOptions& options);

  /// Call a few times a second, while there is work: restarts what died, and what was told to end.
  /// @error kUnavailable when the machine cannot run workers: all ended with exit code 3 at once, or
  /// campaign::HopelessDeaths died without one attempt finished meanwhile; the message says how the last one ended,
  /// with its log's last lines.
  Status Supervise();
  /// In its place where nothing is left to do: what ended is told to `on_end`, and not started again.
  void NoteEnds();
  /// SIGTERM to all, SIGKILL after a few seconds.
  void Stop();
  int restarts() const { return restarts_; }

 private:
  struct Slot {
    std::optional<campaign::Process> process;
    std::string name;  // on the bus
    MonotonicClock::time_point started{}, start_again{};
    int deaths = 0;         // in a row
    bool finished = false;  // nothing is left to do
    bool unable = false;    // to run on this machine, as it was the last time
  };

  explicit WorkerPool(WorkerPoolOptions options) : options_(std::move(options)) {}
  Status StartSlot(std::size_t k);
  Status StartAgain(std::size_t k);
  bool IsHopeless();
  Status OnEnd(std::size_t k, int exit_code);
  void EndSilent();
  Path LogOf(std::size_t k) const;

  WorkerPoolOptions options_;
  Path program_;
  std::vector<Slot> slots_;
  int restarts_ = 0;
  int deaths_ = 0;          // of all workers, since the last attempt was finished
  std::uint64_t done_ = 0;  // when it was looked at last
};

/// On one host: the participants of a DDS domain on a machine are bounded, to 120 by deploy/dds/local.xml, and the
/// other programs need some of them. A host of more cores starts one `etude worker`, whose workers share one
/// participant.
constexpr int kMostWorkers = 100;
/// Number of workers to start when the user does not say: one a core, at most kMostWorkers.
int DefaultWorkers();
/// The last lines of a log file, indented; for error messages.
std::string LogTail(const Path& log, int lines = 5);

}  // namespace etude::cli
