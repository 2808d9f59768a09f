// SPDX-License-Identifier: Apache-2.0
// Counters of GET /metrics, added up over the processes that count.
#pragma once

#include <chrono>
#include <cstddef>
#include <map>
#include <string>
#include <tuple>
#include <utility>

#include "services/core/clock.h"
#include "services/core/thread_annotations.h"

namespace etude::api {

/// Sums over processes that come and go: what one counted stays when it is gone, as a counter must not fall. A series
/// of which nobody counts any more ends after a while: hosts and runs come without end. Thread-safe.
class Counters {
 public:
  using Key = std::pair<std::string, std::string>;  // values of two labels
  using TimePoint = MonotonicClock::time_point;

  static constexpr std::chrono::minutes kForget{10};
  static constexpr std::size_t kMost = 100'000;  // processes; beyond them new ones are not counted

  void Saw(const std::string& family, const Key& key, const std::string& process, double count, TimePoint now) {
    const MutexLock lock(mutex_);
    const auto whose = std::tuple(family, key, process);
    if (!last_.contains(whose) && last_.size() >= kMost) return;
    Counted& last = last_[whose];
    Counted& sum = sums_[family][key];
    // one that began anew counts from 0
    sum.count += count >= last.count ? count - last.count : count;
    last.count = count;
    last.seen = sum.seen = now;
  }
  std::map<Key, double> Sums(const std::string& family) const {
    const MutexLock lock(mutex_);
    std::map<Key, double> sums;
    if (const auto found = sums_.find(family); found != sums_.end())
      for (const auto& [key, sum] : found->second) sums[key] = sum.count;
    return sums;
  }
  /// What was not seen for kForget. After those that are there were: a scrape may be the first for hours.
  void Forget(TimePoint now) {
    const MutexLock lock(mutex_);
    const auto over = [now](const auto& item) { return now - item.second.seen > kForget; };
    std::erase_if(last_, over);
    for (auto& [family, sums] : sums_) std::erase_if(sums, over);
  }

 private:
  struct Counted {
    double count = 0;
    TimePoint seen{};
  };
  mutable Mutex mutex_;
  std::map<std::tuple<std::string, Key, std::string>, Counted> last_ ETUDE_GUARDED_BY(mutex_);  // by process
  std::map<std::string, std::map<Key, Counted>> sums_ ETUDE_GUARDED_BY(mutex_);                 // by family
};

}  // namespace etude::api
