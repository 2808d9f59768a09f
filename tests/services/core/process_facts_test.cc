// SPDX-License-Identifier: Apache-2.0
// Tests services/core/process_facts.cc
#include "services/core/process_facts.h"

#include <gtest/gtest.h>

#include <ctime>

#include "tests/support/temporary_folder.h"

namespace etude {
namespace process_facts_test {

TEST(ProcessMeter, KnowsMemoryAndDisk) {
  const TemporaryFolder folder;
  const ProcessFacts facts = ProcessMeter(folder / "not/there/yet").Measure();
  EXPECT_GT(facts.rss_bytes, 1u << 20);
  EXPECT_GT(facts.disk_total_bytes, 0u);
  EXPECT_LE(facts.disk_free_bytes, facts.disk_total_bytes);
  EXPECT_EQ(ProcessMeter(folder.path()).Measure().disk_total_bytes, facts.disk_total_bytes) << "of the one above it";
}

TEST(ProcessMeter, CountsTheCoresThatAreInUse) {
  constexpr double kUsed = 0.2;  // s of CPU, however long a busy machine takes to give them
  const Stopwatch watch;
  ProcessMeter meter;
  (void)meter.Measure();
  const std::clock_t begin = std::clock();
  volatile double sum = 0;
  while (static_cast<double>(std::clock() - begin) < kUsed * CLOCKS_PER_SEC) sum = sum + 1;
  const double cpu = meter.Measure().cpu;
  EXPECT_GE(cpu, 0.9 * kUsed / watch.Seconds());
  EXPECT_LT(cpu, 4);
}

}  // namespace process_facts_test
}  // namespace etude
