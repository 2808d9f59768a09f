// SPDX-License-Identifier: Apache-2.0
// Tests wait on conditions.
#pragma once

#include <chrono>
#include <functional>
#include <thread>

#include "services/core/clock.h"

namespace etude {

/// Looks again and again until it is met, at most `patience`; whether it was.
inline bool WaitUntil(const std::function<bool()>& met, std::chrono::milliseconds patience = std::chrono::seconds(60)) {
  for (const auto end = Deadline(patience); !met(); std::this_thread::sleep_for(std::chrono::milliseconds(5)))
    if (MonotonicClock::now() > end) return met();
  return true;
}

}  // namespace etude
