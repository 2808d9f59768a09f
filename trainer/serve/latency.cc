// SPDX-License-Identifier: Apache-2.0
#include "trainer/serve/latency.h"

#include <fmt/format.h>

#include <utility>
#include <vector>

#include "services/core/statistics.h"

namespace etude::serve {

void LatencyMeter::AddTrial(double ms) {
  const MutexLock lock(mutex_);
  trials_.push_back(ms);
}

void LatencyMeter::Add(double ms) {
  const MutexLock lock(mutex_);
  answers_.push_back(ms);
  if (answers_.size() > kWindow) answers_.pop_front();
  ++count_;
}

Latency LatencyMeter::Now() const {
  const MutexLock lock(mutex_);
  const auto& from = answers_.size() >= kTrusted || trials_.empty() ? answers_ : trials_;
  if (from.empty()) return {};
  std::vector<double> values(from.begin(), from.end());
  const double p50_ms = Quantile(values, 0.5);
  const double p95_ms = Quantile(values, 0.95);
  return {count_, p50_ms, p95_ms, Quantile(std::move(values), 0.99)};
}

std::string ToString(const Latency& latency) {
  return fmt::format("p50 {:.1f} ms, p99 {:.1f} ms", latency.p50_ms, latency.p99_ms);
}

}  // namespace etude::serve
