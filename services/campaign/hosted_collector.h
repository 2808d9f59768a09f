// SPDX-License-Identifier: Apache-2.0
// A collector on a thread of its own, in a program that has other work: it is asked now and then how it is.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "services/campaign/collector.h"
#include "services/core/thread_annotations.h"

namespace etude::campaign {

/// Thread-safe.
class HostedCollector {
 public:
  /// Reads the campaign file as every command does (generated objects by their names) and opens the collector.
  /// @error as LoadSpec and Collector::Open.
  static Result<std::unique_ptr<HostedCollector>> Start(const bus::Participant& participant,
                                                        const std::string& spec_file, const Path& dataset,
                                                        const CollectorOptions& options = {});
  /// Stops it and waits.
  ~HostedCollector();
  HostedCollector(const HostedCollector&) = delete;
  HostedCollector& operator=(const HostedCollector&) = delete;

  /// Well while it runs and after it has finished; what it ended with otherwise.
  Status status() const ETUDE_EXCLUDES(mutex_);
  /// Whether it commits nothing more. Any thread.
  bool ended() const { return ended_; }

 private:
  explicit HostedCollector(Collector collector);

  Collector collector_;
  std::atomic<bool> ended_{false};
  mutable Mutex mutex_;
  Status status_ ETUDE_GUARDED_BY(mutex_);
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace etude::campaign
