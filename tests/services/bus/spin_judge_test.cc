// SPDX-License-Identifier: Apache-2.0
// Tests services/bus/spin_judge.cc
#include "services/bus/spin_judge.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdint>

namespace etude::bus {
namespace spin_judge_test {

TEST(SpinJudge, FindsAThreadOfTheLibraryThatTurnsForHalfAMinute) {
  SpinJudge judge;
  for (int s = 0; s <= 100; s += 2) {
    // gc turns from the 40th second on and gets nine tenths of a core; the trainer's own threads may
    const double gc = s < 40 ? 0.001 * s : 0.04 + 0.9 * (s - 40);
    const auto found = judge.Look({{1, "trainer", 1.0 * s}, {2, "gc", gc}, {3, "fsm", 0.01 * s}}, s);
    EXPECT_EQ(found.has_value(), s >= 70) << s;
    EXPECT_EQ(found ? found->name : "gc", "gc") << s;
  }
}

TEST(SpinJudge, ABusyWhileOrAnotherThreadOfTheNumberIsNone) {
  SpinJudge judge;
  double cpu = 0;
  for (int s = 0; s <= 200; s += 2) {
    cpu += s % 20 == 0 ? 0.2 : 2;  // every 20 s it rests for a moment
    EXPECT_FALSE(judge.Look({{2, "gc", cpu}}, s)) << s;
  }
  for (int s = 202; s < 300; s += 2) EXPECT_FALSE(judge.Look({{static_cast<std::uint64_t>(s), "fsm", 2.0 * s}}, s));
}

TEST(SpinJudge, HandshakesOfManyWhoJoinAtOnceAreWork) {
  SpinJudge judge;
  for (int s = 0; s <= 100; s += 2)
    EXPECT_FALSE(judge.Look({{3, "fsm", 1.0 * s}}, s, static_cast<std::uint64_t>(s) / 10)) << s;
  EXPECT_FALSE(judge.Look({{3, "fsm", 128}}, 128, 10));
  EXPECT_TRUE(judge.Look({{3, "fsm", 132}}, 132, 10)) << "nobody was admitted for half a minute";
}

TEST(SpinJudge, ReadsTheKernelsLines) {
  const auto thread = ParseThreadStat("77 (a) (b) S 1 2 3 4 5 6 7 8 9 10 250 50 0 0 20 0 9 0 1234");
  ASSERT_TRUE(thread);
  EXPECT_EQ(thread->id, 77u);
  EXPECT_EQ(thread->name, "a) (b");
  EXPECT_DOUBLE_EQ(thread->cpu_s, 300.0 / static_cast<double>(::sysconf(_SC_CLK_TCK)));
  EXPECT_FALSE(ParseThreadStat(""));
  EXPECT_FALSE(ParseThreadStat("77 (gc"));
  EXPECT_FALSE(ParseThreadStat("77 (gc) S 1 2"));
  EXPECT_FALSE(ThreadTimes().empty());
}

}  // namespace spin_judge_test
}  // namespace etude::bus
