// SPDX-License-Identifier: Apache-2.0
// Tests trainer/curriculum/scheduler.cc
#include "trainer/curriculum/scheduler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "services/core/rng.h"

namespace etude::curriculum {
namespace scheduler_test {

using ::testing::HasSubstr;

std::vector<Subtask> FiveLevels() {
  return {{1, {"LANG"}}, {2, {"EE2D", "TAR2D"}}, {3, {"EE3D", "TAR3D"}}, {4, {"DISP"}}, {5, {"CTRL"}}};
}

TEST(Scheduler, TrainsOnlyTheFirstSubtaskAtFirst) {
  const Scheduler scheduler({}, FiveLevels());

  EXPECT_EQ(scheduler.stage(), 1);
  EXPECT_EQ(scheduler.level(), 1);
  EXPECT_EQ(scheduler.StageName(), "LANG");
}

TEST(Scheduler, TrainsEverythingAtOnceWhenDisabled) {
  CurriculumConfig config;
  config.enabled = false;
  Scheduler scheduler(config, FiveLevels());

  EXPECT_EQ(scheduler.level(), 5);
  EXPECT_FALSE(scheduler.Tick(1, 1.0));
}

TEST(Scheduler, StartsAtTheLevelThatHasSomethingToLearn) {
  Scheduler scheduler({}, FiveLevels());
  scheduler.StartAt(3);

  EXPECT_EQ(scheduler.stage(), 3);
  EXPECT_EQ(scheduler.level(), 3);
  Scheduler later({}, FiveLevels());
  ASSERT_TRUE(later.Restore(scheduler.Save()));
  EXPECT_EQ(later.stage(), 3);
}

TEST(Scheduler, SaysWhenRelabelledCommandsAreAsked) {
  const auto at = [](const char* relabelled, int level) {
    CurriculumConfig config;
    config.relabelled = relabelled;
    return Scheduler(config, FiveLevels()).RelabelledAt(level);
  };
  for (int level = 1; level <= 5; ++level) {
    EXPECT_TRUE(at("always", level));
    EXPECT_FALSE(at("never", level));
    EXPECT_EQ(at("before_last", level), level < 5) << level;
  }
}

TEST(CurriculumConfig, NamesAnUnknownChoiceOfRelabelling) {
  CurriculumConfig config;
  config.relabelled = "allways";
  std::vector<std::string> errors;
  config.Check(errors);
  EXPECT_THAT(errors, testing::ElementsAre(HasSubstr("did you mean 'always'")));
}

TEST(Scheduler, StaysWhileTheErrorFallsAndGoesOnWhenItStops) {
  CurriculumConfig config;
  config.latest_last = 1;
  Scheduler scheduler(config, FiveLevels());

  double error = 1;
  for (int i = 0; i < 10; ++i, error *= 0.7) ASSERT_FALSE(scheduler.Observe(100, 0.01, {{"LANG", error}})) << i;
  ASSERT_FALSE(scheduler.Observe(1100, 0.01, {{"LANG", error}}));
  std::optional<Advance> advance;
  for (int i = 0; i < 3 && !advance; ++i) advance = scheduler.Observe(1200, 0.01, {{"LANG", error}});

  ASSERT_TRUE(advance);
  EXPECT_EQ(advance->cause, Cause::kConverged);
  EXPECT_EQ(scheduler.stage(), 2);
}

TEST(Scheduler, WaitsForEveryModuleOfTheSubtask) {
  CurriculumConfig config;
  config.goals = {{"LANG", 0.01}, {"EE2D", 0.5}, {"TAR2D", 0.5}};
  config.latest_last = 1;
  Scheduler scheduler(config, FiveLevels());
  ASSERT_TRUE(scheduler.Observe(1, 0, {{"LANG", 0.0}}));

  EXPECT_FALSE(scheduler.Observe(2, 0, {{"EE2D", 0.1}}));
  EXPECT_FALSE(scheduler.Observe(3, 0, {{"EE2D", 0.1}, {"TAR2D", 2.0}}));
  const auto advance = scheduler.Observe(4, 0, {{"EE2D", 0.1}, {"TAR2D", 0.4}});

  ASSERT_TRUE(advance);
  EXPECT_EQ(advance->cause, Cause::kGoal);
  EXPECT_THAT(advance->reason, HasSubstr("TAR2D"));
}

TEST(Scheduler, NeverConvergesOnErrorsThatAreNotNumbers) {
  CurriculumConfig config;
  config.latest_last = 1;
  Scheduler scheduler(config, FiveLevels());

  for (int i = 0; i < 20; ++i)
    EXPECT_FALSE(scheduler.Observe(1, 0.1, {{"LANG", std::numeric_limits<double>::quiet_NaN()}}));
}

// before, a module that is never measured held its stage until the budget ended it, without a word
TEST(Scheduler, SaysThatAModuleHasNoMeasuredError) {
  CurriculumConfig config;
  config.goals = {{"LANG", 0.01}};
  config.latest_last = 0.4;
  Scheduler scheduler(config, FiveLevels());
  ASSERT_TRUE(scheduler.Observe(1, 0, {{"LANG", 0.0}}));
  EXPECT_FALSE(scheduler.NewlyUnmeasured());

  EXPECT_FALSE(scheduler.Observe(2, 0.01, {{"EE2D", 0.1}}));
  EXPECT_THAT(scheduler.unmeasured(), ::testing::ElementsAre("TAR2D"));
  EXPECT_TRUE(scheduler.NewlyUnmeasured());
  EXPECT_FALSE(scheduler.Observe(3, 0.02, {{"EE2D", 0.1}}));
  EXPECT_FALSE(scheduler.NewlyUnmeasured());  // said once a stage

  const auto advance = scheduler.Tick(4, 0.3);
  ASSERT_TRUE(advance);
  EXPECT_EQ(advance->cause, Cause::kBudget);
  EXPECT_THAT(advance->reason, HasSubstr("TAR2D has no measured error"));
  EXPECT_TRUE(scheduler.unmeasured().empty());
}

TEST(Scheduler, ReachesTheLastSubtaskWithinItsBudget) {
  CurriculumConfig config;
  config.latest_last = 0.2;
  Scheduler scheduler(config, FiveLevels());

  for (int i = 0; i <= 200; ++i) scheduler.Tick(static_cast<std::uint64_t>(i), i / 1000.0);

  EXPECT_EQ(scheduler.stage(), 5);
  for (const auto& advance : scheduler.advances()) EXPECT_EQ(advance.cause, Cause::kBudget);
  EXPECT_EQ(scheduler.advances()[0].step, 50u);
  EXPECT_EQ(scheduler.advances()[3].step, 200u);
}

// whatever the errors do, the invariants of the class comment hold, and a restored one does the
// same
TEST(Scheduler, KeepsItsInvariantsOnRandomErrors) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Rng rng(seed);
    CurriculumConfig config;
    config.patience = 1 + static_cast<int>(rng.Below(4));
    config.improvement = rng.Uniform(0, 0.5);
    config.latest_last = rng.Uniform();
    if (rng.Bernoulli(0.5)) config.goals["TAR3D"] = rng.Uniform();
    Scheduler scheduler(config, FiveLevels());
    Scheduler copy(config, FiveLevels());
    int last = 1;
    for (int i = 0; i <= 100; ++i) {
      std::map<std::string, double> errors;
      for (const char* module : {"LANG", "EE2D", "TAR2D", "EE3D", "TAR3D", "DISP", "CTRL"})
        if (rng.Bernoulli(0.9)) errors[module] = rng.Uniform();
      const auto advance = scheduler.Observe(static_cast<std::uint64_t>(i), i / 100.0, errors);

      ASSERT_EQ(scheduler.stage(), last + (advance ? 1 : 0));
      ASSERT_LE(scheduler.stage(), scheduler.stages());
      if (advance) {
        ASSERT_FALSE(advance->reason.empty());
      }
      last = scheduler.stage();

      // save, restore into another, and let that one see the same
      ASSERT_EQ(copy.Observe(static_cast<std::uint64_t>(i), i / 100.0, errors).has_value(), advance.has_value());
      Scheduler fresh(config, FiveLevels());
      ASSERT_TRUE(fresh.Restore(OrderedJson::parse(copy.Save().dump())));
      ASSERT_EQ(fresh.Save(), scheduler.Save());
      copy = std::move(fresh);
    }
    EXPECT_EQ(last, scheduler.stages());
  }
}

TEST(Scheduler, RefusesAStateOfAnotherPolicy) {
  Scheduler scheduler({}, FiveLevels());
  Scheduler other({}, {{1, {"LANG"}}});
  const OrderedJson before = scheduler.Save();

  EXPECT_EQ(scheduler.Restore(other.Save()).error().code, Code::kCorrupt);
  EXPECT_EQ(scheduler.Restore(OrderedJson::object()).error().code, Code::kCorrupt);
  EXPECT_EQ(scheduler.Save(), before);
}

// before, a run that went on without curriculum stayed in the stage that it had
TEST(Scheduler, ThatWasSwitchedOffTrainsEverythingFromThenOn) {
  const Scheduler scheduler({}, FiveLevels());
  CurriculumConfig off;
  off.enabled = false;
  Scheduler resumed(off, FiveLevels());

  ASSERT_TRUE(resumed.Restore(scheduler.Save()));

  EXPECT_EQ(resumed.stage(), resumed.stages());
}

}  // namespace scheduler_test
}  // namespace etude::curriculum
