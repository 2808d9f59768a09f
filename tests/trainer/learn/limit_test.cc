// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/limit.cc
#include "trainer/learn/limit.h"

#include <gtest/gtest.h>

#include <utility>

namespace etude::learn {
namespace limit_test {

TEST(RunLimit, OfStepsDoesNotLookAtTheClock) {
  RunLimit limit(100, 0);
  EXPECT_EQ(limit.Progress(25, 1e9), 0.25);
  EXPECT_FALSE(limit.Observe(25, 1e9, true));
  EXPECT_EQ(limit.Progress(200, 0), 1);
}

// 10 minutes; a step takes 1 s while all modules train
TEST(RunLimit, TurnsMinutesIntoSteps) {
  RunLimit limit(0, 10);
  std::uint64_t step = 0;
  double elapsed = 0;
  // the early stages are cheap and are not measured
  for (; step < 300; ++step, elapsed += 0.1) EXPECT_FALSE(limit.Observe(step, elapsed, false));
  EXPECT_NEAR(limit.Progress(step, elapsed), 30.0 / 600, 1e-9);
  bool converted = false;
  for (; !converted; ++step, elapsed += 1) converted = limit.Observe(step, elapsed, true);
  EXPECT_EQ(step, 300 + kMeasuredSteps + 1);
  // 230 s are over when it is measured, 370 remain
  EXPECT_EQ(limit.minutes(), 0);
  EXPECT_EQ(limit.steps(), 500u + 370u);

  // from now on the clock says nothing, and progress goes on where it was
  EXPECT_NEAR(limit.Progress(500, 1e9), 230.0 / 600, 1e-9);
  EXPECT_NEAR(limit.Progress(685, 0), (230.0 / 600 + 1) / 2, 1e-9);
  EXPECT_EQ(limit.Progress(870, 0), 1);
}

// as fast as it was measured: the clock has no say at all
TEST(RunLimit, LooksAgainAndLeavesWhatIsRight) {
  RunLimit limit(0, 10);
  int changes = 0;
  for (std::uint64_t step = 0; limit.Progress(step, static_cast<double>(step)) < 1; ++step)
    changes += limit.Observe(step, static_cast<double>(step), true);
  EXPECT_EQ(changes, 1);
  EXPECT_EQ(limit.steps(), 600u);
}

// Seconds until the end of a run of ten minutes on a machine whose steps take `later` instead of 0.1 s from step 1,000
// on.
double SecondsOf(double later, RunLimit limit = RunLimit(0, 10), std::uint64_t from = 1000) {
  double elapsed = 0, progress = 0;
  for (std::uint64_t step = 0; progress < 1; ++step) {
    limit.Observe(step, elapsed, true);
    EXPECT_GE(limit.Progress(step, elapsed), progress - 1e-9) << "at step " << step;
    progress = limit.Progress(step, elapsed);
    elapsed += step < from ? 0.1 : later;
  }
  return elapsed;
}

TEST(RunLimit, KeepsTheMinutesOnAMachineThatGetsSlowerOrFaster) {
  EXPECT_NEAR(SecondsOf(0.15), 600, 0.003 * 600) << "850 s by what was measured first";
  EXPECT_NEAR(SecondsOf(0.07), 600, 0.003 * 600);
  EXPECT_NEAR(SecondsOf(0.12, RunLimit(0, 10), 4800), 600, 0.01 * 600) << "slower from the last fifth on: 624 s";
  EXPECT_LT(SecondsOf(0.07, RunLimit(3000, 10)), 0.5 * 600) << "the steps that were asked for stay the most";
}

// What is done beside a step (a checkpoint, a validation) is not taken for the time of each that follows.
TEST(RunLimit, IsNotBentByOneLongStep) {
  RunLimit limit(0, 10);
  double elapsed = 0;
  bool converted = false;
  for (std::uint64_t step = 0; limit.Progress(step, elapsed) < 1; ++step, elapsed += 1) {
    if (limit.Observe(step, elapsed, true) && !std::exchange(converted, true)) elapsed += 5;  // what is kept then
    if (converted) {
      ASSERT_NEAR(static_cast<double>(limit.steps()), 600, 15) << "at step " << step;
    }
  }
  EXPECT_TRUE(converted);
}

// A kill between state and config.yaml leaves the steps of before in the latter.
TEST(RunLimit, GoesOnWhereConfigurationSaysTheStepsOfBeforeTheLook) {
  RunLimit limit(0, 10);
  std::uint64_t step = 0;
  for (; !limit.Observe(step, static_cast<double>(step), true); ++step) {
  }
  const std::uint64_t before = limit.steps();
  for (; limit.steps() == before; ++step) limit.Observe(step, 2.0 * static_cast<double>(step), true);
  RunLimit resumed(before, 0);
  ASSERT_TRUE(resumed.Restore(limit.Save()));
  EXPECT_EQ(resumed.Save(), limit.Save());
}

TEST(RunLimit, OfAnEarlierProgramStaysAsItWasConverted) {
  RunLimit limit(600, 0);
  ASSERT_TRUE(limit.Restore(
      {{"asked_minutes", 10.0}, {"minutes", 0.0}, {"steps", 600}, {"anchor_step", 200}, {"anchor_progress", 0.3}}));
  for (std::uint64_t step = 200; step < 600; ++step)
    EXPECT_FALSE(limit.Observe(step, 9.0 * static_cast<double>(step), true));
  EXPECT_EQ(limit.steps(), 600u);
}

// One that looked at the quarters, and said from where it had been converted.
TEST(RunLimit, OfAWhileAgoLooksOnlyWhereItWouldHave) {
  const auto saved = [](int looks) {
    return OrderedJson{{"asked_minutes", 10.0}, {"asked_steps", 0},    {"minutes", 0.0},
                       {"steps", 6000},         {"anchor_step", 1000}, {"anchor_progress", 1.0 / 6},
                       {"anchor_s", 100.0},     {"looks", looks},      {"steps_before", 0}};
  };
  RunLimit over(0, 10), under_way(0, 10);
  ASSERT_TRUE(over.Restore(saved(3)));
  ASSERT_TRUE(under_way.Restore(saved(1)));
  for (std::uint64_t step = 4600; step < 6000; ++step)
    EXPECT_FALSE(over.Observe(step, 0.2 * static_cast<double>(step), true));
  EXPECT_EQ(over.steps(), 6000u);
  EXPECT_TRUE(under_way.Observe(3000, 100 + 2000 * 0.15, true));
  EXPECT_EQ(under_way.steps(), 3000u + 1333u) << "200 s are left, and a step took 0.15 s since it was converted";
}

TEST(RunLimit, AStepIsMeasuredSinceTheLastLookAlsoWhereThatChangedNothing) {
  RunLimit limit(0, 10);
  std::uint64_t step = 0;
  for (; step <= 1500; ++step) limit.Observe(step, 0.1 * static_cast<double>(step), true);
  ASSERT_EQ(limit.steps(), 6000u) << "as fast as it was measured";
  double elapsed = 150;
  for (; step < 3100; ++step) limit.Observe(step, elapsed += 0.11, true);
  EXPECT_NEAR(static_cast<double>(limit.steps()), 3000 + (600 - 150 - 1500 * 0.11) / 0.11, 5);
}

// A look that waited for enough steps and is due with the last one: the run has as many as it did.
TEST(RunLimit, TheLastStepIsTheLast) {
  RunLimit limit(0, 10);
  std::uint64_t step = 0;
  double elapsed = 0;
  while (limit.minutes() > 0) limit.Observe(step++, elapsed += 600.0 / 401, true);
  while (limit.Progress(step, elapsed) < 1) limit.Observe(++step, elapsed += 1.3, true);
  EXPECT_EQ(step, 400u);
  EXPECT_EQ(limit.steps(), 400u);
  EXPECT_FALSE(limit.Observe(step, elapsed, true));
}

TEST(RunLimit, GoesOnWithTheStepsThatAnEarlierRunMeasured) {
  RunLimit first(0, 10);
  for (std::uint64_t step = 0; !first.Observe(step, static_cast<double>(step), true); ++step) {
  }
  const OrderedJson saved = first.Save();
  RunLimit by_minutes(0, 10);  // the command line again
  ASSERT_TRUE(by_minutes.Restore(saved));
  EXPECT_EQ(by_minutes.steps(), first.steps());
  EXPECT_EQ(by_minutes.minutes(), 0);
  EXPECT_EQ(by_minutes.Progress(300, 1e9), first.Progress(300, 0));

  RunLimit by_steps(first.steps(), 0);  // config.yaml
  ASSERT_TRUE(by_steps.Restore(saved));
  EXPECT_EQ(by_steps.Progress(300, 1e9), first.Progress(300, 0));

  RunLimit uninterrupted = first;
  for (auto* limit : {&uninterrupted, &by_steps}) EXPECT_TRUE(limit->Observe(400, 500, true)) << "slower by now";
  EXPECT_EQ(by_steps.Save(), uninterrupted.Save());

  RunLimit longer(0, 20);  // another limit is another one
  ASSERT_TRUE(longer.Restore(saved));
  EXPECT_EQ(longer.minutes(), 20);
  EXPECT_EQ(longer.steps(), 0u);

  RunLimit bounded(300, 10);  // so are the same minutes with another bound
  ASSERT_TRUE(bounded.Restore(saved));
  EXPECT_EQ(bounded.minutes(), 10);
  EXPECT_EQ(bounded.steps(), 300u);

  EXPECT_EQ(longer.Restore({{"steps", "many"}}).error().code, Code::kCorrupt);
}

TEST(RunLimit, ThatEndedByTimeIsAsManySteps) {
  RunLimit limit(0, 1);
  EXPECT_EQ(limit.Progress(50, 60), 1);
  limit.EndAt(50);
  EXPECT_EQ(limit.steps(), 50u);
  EXPECT_EQ(limit.Progress(50, 0), 1);
}

TEST(RunLimit, WithBothEndsAtWhicheverComesFirst) {
  RunLimit limit(1000, 10);
  for (std::uint64_t step = 0; !limit.Observe(step, static_cast<double>(step), true); ++step) {
  }
  EXPECT_EQ(limit.steps(), 600u);
  RunLimit few(250, 10);
  for (std::uint64_t step = 0; !few.Observe(step, static_cast<double>(step), true); ++step) {
  }
  EXPECT_EQ(few.steps(), 250u);
}

}  // namespace limit_test
}  // namespace etude::learn
