// SPDX-License-Identifier: Apache-2.0
// How long answers take, from an observation's arrival to its action's departure.
#pragma once

#include <cstdint>
#include <deque>
#include <string>

#include "services/core/thread_annotations.h"

namespace etude::serve {

struct Latency {
  std::uint64_t answers = 0;  ///< since the start; 0: these are of the server's own trials
  double p50_ms = 0, p95_ms = 0, p99_ms = 0;
};

/// Quantiles over the last kWindow answers; before the first kTrusted of them over the trials that the server made
/// with its first checkpoint, so that a client has a number at once. Thread-safe.
class LatencyMeter {
 public:
  static constexpr std::size_t kWindow = 2048;
  static constexpr std::size_t kTrusted = 20;

  void AddTrial(double ms) ETUDE_EXCLUDES(mutex_);
  void Add(double ms) ETUDE_EXCLUDES(mutex_);
  /// Zeros when nothing was measured.
  Latency Now() const ETUDE_EXCLUDES(mutex_);

 private:
  mutable Mutex mutex_;
  std::deque<double> trials_ ETUDE_GUARDED_BY(mutex_), answers_ ETUDE_GUARDED_BY(mutex_);
  std::uint64_t count_ ETUDE_GUARDED_BY(mutex_) = 0;
};

/// "p50 8.3 ms, p99 12.1 ms".
std::string ToString(const Latency& latency);

}  // namespace etude::serve
