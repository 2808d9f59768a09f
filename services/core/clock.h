// SPDX-License-Identifier: Apache-2.0
// Time. Leases, rates and deadlines use the monotonic clock; wall-clock stamps are only for people.
#pragma once

#include <chrono>
#include <string>

namespace etude {

using MonotonicClock = std::chrono::steady_clock;

/// `timeout` from now, at most the end of time: for timeouts such as std::chrono::nanoseconds::max().
inline MonotonicClock::time_point Deadline(std::chrono::nanoseconds timeout) {
  const auto now = MonotonicClock::now();
  constexpr auto kLatest = MonotonicClock::time_point::max();
  return timeout > kLatest - now ? kLatest : now + timeout;
}

/// Seconds of CPU-independent elapsed time, for measuring.
class Stopwatch {
 public:
  double Seconds() const { return std::chrono::duration<double>(MonotonicClock::now() - start_).count(); }
  void Restart() { start_ = MonotonicClock::now(); }

 private:
  MonotonicClock::time_point start_ = MonotonicClock::now();
};

/// Wall-clock seconds since the epoch; only for stamps that people or TensorBoard read.
double WallSeconds();
/// Seconds since the host's start, its sleep among them: the same for every process of it, whatever the wall clock is
/// set to. For what one program leaves to the next one.
double BootSeconds();
/// "1:23:45" or "2:05".
std::string FormatDuration(double seconds);

}  // namespace etude
