// SPDX-License-Identifier: Apache-2.0
// Tests trainer/serve/latency.cc
#include "trainer/serve/latency.h"

#include <gtest/gtest.h>

namespace etude::serve {
namespace latency_test {

TEST(LatencyMeter, SaysZeroBeforeAnythingIsMeasured) {
  EXPECT_EQ(LatencyMeter().Now().p99_ms, 0);
  EXPECT_EQ(LatencyMeter().Now().answers, 0u);
}

TEST(LatencyMeter, HasTrialsUntilThereAreEnoughAnswers) {
  LatencyMeter meter;
  for (int i = 0; i < 5; ++i) meter.AddTrial(3);
  meter.Add(50);
  EXPECT_EQ(meter.Now().p50_ms, 3);
  EXPECT_EQ(meter.Now().answers, 1u);
  for (std::size_t i = 1; i < LatencyMeter::kTrusted; ++i) meter.Add(50);
  EXPECT_EQ(meter.Now().p50_ms, 50);
}

TEST(LatencyMeter, IsOfTheLastAnswers) {
  LatencyMeter meter;
  for (int i = 0; i < 100; ++i) meter.Add(1000);
  for (std::size_t i = 0; i < LatencyMeter::kWindow; ++i) meter.Add(static_cast<double>(i % 100));
  const Latency latency = meter.Now();
  EXPECT_NEAR(latency.p50_ms, 48, 1);  // the window is no multiple of 100: 0 to 47 are in it once more
  EXPECT_NEAR(latency.p95_ms, 94, 1);
  EXPECT_NEAR(latency.p99_ms, 98, 1);
  EXPECT_EQ(ToString({3, 8.34, 11, 12.1}), "p50 8.3 ms, p99 12.1 ms");
}

}  // namespace latency_test
}  // namespace etude::serve
