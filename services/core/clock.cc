// SPDX-License-Identifier: Apache-2.0
#include "services/core/clock.h"

#include <fmt/format.h>
#include <time.h>

#include <algorithm>

namespace etude {

double WallSeconds() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

double BootSeconds() {
  timespec now{};
  ::clock_gettime(CLOCK_BOOTTIME, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

std::string FormatDuration(double seconds) {
  const auto total = static_cast<long>(std::max(0.0, seconds) + 0.5);
  const long h = total / 3600, m = total / 60 % 60, s = total % 60;
  return h > 0 ? fmt::format("{}:{:02}:{:02}", h, m, s) : fmt::format("{}:{:02}", m, s);
}

}  // namespace etude
