// SPDX-License-Identifier: Apache-2.0
// What came over the bus, and when.
#pragma once

#include <chrono>

#include "services/core/clock.h"

namespace etude::monitor {

template <class Message>
struct Heard {
  Message message;
  MonotonicClock::time_point at{};
  double AgeSeconds(MonotonicClock::time_point now) const { return std::chrono::duration<double>(now - at).count(); }
};

}  // namespace etude::monitor
