// SPDX-License-Identifier: Apache-2.0
// Tests services/core/clock.cc
#include "services/core/clock.h"

#include <gtest/gtest.h>

namespace etude {
namespace clock_test {

TEST(Deadline, IsAtMostTheEndOfTime) {
  const auto before = MonotonicClock::now();
  const auto soon = Deadline(std::chrono::seconds(10));
  EXPECT_GE(soon, before + std::chrono::seconds(10));
  EXPECT_LE(soon, MonotonicClock::now() + std::chrono::seconds(10));
  EXPECT_EQ(Deadline(std::chrono::nanoseconds::max()), MonotonicClock::time_point::max());
}

TEST(FormatDuration, ReadsLikeAClock) {
  EXPECT_EQ(FormatDuration(5), "0:05");
  EXPECT_EQ(FormatDuration(125.4), "2:05");
  EXPECT_EQ(FormatDuration(3600 + 23 * 60 + 45), "1:23:45");
  EXPECT_EQ(FormatDuration(-1), "0:00");
}

TEST(FormatDuration, RoundsToSecondsAndCarries) {
  EXPECT_EQ(FormatDuration(0.49), "0:00");
  EXPECT_EQ(FormatDuration(59.5), "1:00");
  EXPECT_EQ(FormatDuration(3599.4), "59:59");
  EXPECT_EQ(FormatDuration(3599.5), "1:00:00");
  EXPECT_EQ(FormatDuration(100 * 3600 + 61), "100:01:01");
}

}  // namespace clock_test
}  // namespace etude
