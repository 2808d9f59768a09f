// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/evaluation.cc
#include "services/cli/evaluation.h"

#include <gtest/gtest.h>

#include <map>
#include <set>

#include "services/spec/episode_plan.h"
#include "tests/support/matchers.h"

namespace etude::cli {
namespace evaluation_test {

EvaluationOptions Options(const Path& out) {
  EvaluationOptions options;
  options.run = "demo";
  options.out = out;
  return options;
}

TEST(EvaluationSpec, EightyRolloutsAre32And24And24) {
  const CampaignSpec spec = EvaluationSpec(CampaignSpec{}, Options("out/a"));
  ASSERT_TRUE(spec.Validate()) << spec.Validate().error().message;
  EXPECT_EQ(spec.mode, "rollout");
  std::map<std::string, int> counts;
  for (std::uint64_t i = 0; i < spec.episodes; ++i) ++counts[PlanEpisode(spec, i, 0).task.text()];
  EXPECT_EQ(counts, (std::map<std::string, int>{{"pick", 32}, {"push", 24}, {"put_down", 24}}));
}

// the spec of a collection that follows its trainer is rolled out as any other
TEST(EvaluationSpec, FollowsNoSamplingWeights) {
  CampaignSpec base;
  base.adaptive_sampling.share = 0.5;
  const CampaignSpec spec = EvaluationSpec(base, Options("out/a"));
  EXPECT_TRUE(spec.Validate()) << (spec.Validate() ? "" : spec.Validate().error().message);
  EXPECT_EQ(SpecHash(spec), SpecHash(EvaluationSpec(CampaignSpec{}, Options("out/a"))));
}

TEST(EvaluationSpec, SeedsNeverMeetThoseOfACollection) {
  std::set<std::uint64_t> collected;
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    CampaignSpec spec;
    spec.seed = seed;
    for (std::uint64_t i = 0; i < 100; ++i)
      for (std::uint32_t attempt = 0; attempt < 3; ++attempt) collected.insert(EpisodeSeed(spec, i, attempt));
  }
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    auto options = Options("out/a");
    options.seed = seed;
    const CampaignSpec spec = EvaluationSpec(CampaignSpec{}, options);
    EXPECT_GT(spec.seed, 1'000'000u) << "a seed that nobody types";
    for (std::uint64_t i = 0; i < 100; ++i) EXPECT_FALSE(collected.contains(EpisodeSeed(spec, i, 0)));
  }
}

TEST(EvaluationSpec, KeepsTheScenesOfItsCampaignAndNamesItselfByFolder) {
  CampaignSpec base;
  base.camera.width = 96;
  base.objects = {"coke", "milk"};
  auto options = Options("out/a");
  options.tasks = {"push"};
  const CampaignSpec spec = EvaluationSpec(base, options);
  EXPECT_EQ(spec.camera.width, 96);
  EXPECT_EQ(spec.objects, base.objects);
  EXPECT_TRUE(spec.task_weights.empty());
  EXPECT_EQ(spec.tasks, options.tasks);
  EXPECT_EQ(spec.name, EvaluationSpec(base, Options("out/../out/a")).name);
  EXPECT_NE(spec.name, EvaluationSpec(base, Options("out/b")).name);
}

TEST(EvaluationSpec, TakesTheTasksOfItsCampaign) {
  CampaignSpec base;
  EXPECT_EQ(EvaluationSpec(base, Options("out/a")).task_weights, (std::vector<double>{4, 3, 3}));
  base.task_weights = {1, 1, 2};
  EXPECT_EQ(EvaluationSpec(base, Options("out/a")).task_weights, base.task_weights);
  base.tasks = {"rotate", "place_left"};
  base.task_weights = {1, 3};
  const CampaignSpec spec = EvaluationSpec(base, Options("out/a"));
  EXPECT_EQ(spec.tasks, base.tasks);
  EXPECT_EQ(spec.task_weights, base.task_weights);
}

TEST(EvaluationSpec, SuitesReplaceOnlyWhatTheyAreAbout) {
  CampaignSpec base;
  base.rollout.occlude = 0.42;
  base.rollout.pushes = {.count = 2, .least = 0.04};
  auto options = Options("out/a");
  EXPECT_EQ(EvaluationSpec(base, options).rollout.occlude, 0.42) << "the campaign's own";
  EXPECT_EQ(EvaluationSpec(base, options).rollout.pushes.count, 2);
  options.occlude = 0;
  options.pushes = 1;
  const CampaignSpec spec = EvaluationSpec(base, options);
  EXPECT_EQ(spec.rollout.occlude, 0);
  EXPECT_EQ(spec.rollout.pushes.count, 1);
  EXPECT_EQ(spec.rollout.pushes.least, 0.04) << "the rest stays";
  EXPECT_TRUE(spec.rollout.sentences.empty());
}

TEST(CheckOverlay, NeedsVideosAndPictures) {
  auto options = Options("out/a");
  CampaignSpec spec;
  EXPECT_THAT(CheckOverlay(options, spec), IsOk());
  options.overlay = true;
  EXPECT_THAT(CheckOverlay(options, spec), IsOk());
  options.videos = 0;
  EXPECT_THAT(CheckOverlay(options, spec), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(CheckOverlay(options, spec), MessageHas("--videos"));
  options.videos = 3;
  spec.rollout.record = false;
  EXPECT_THAT(CheckOverlay(options, spec), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(CheckOverlay(options, spec), MessageHas("rollout.record"));
  options.overlay = false;
  options.videos = 0;
  EXPECT_THAT(CheckOverlay(options, spec), IsOk());
  options.insight = true;
  EXPECT_THAT(CheckOverlay(options, spec), MessageHas("--insight"));
  spec.rollout.record = true;
  EXPECT_THAT(CheckOverlay(options, spec), IsOk()) << "insights need no videos";
}

TEST(EvaluationSpec, SentencesBringTheirTasks) {
  CampaignSpec base;
  base.task_weights = {1, 2, 3};
  auto options = Options("out/a");
  options.sentences = {
      {"shove it", "push", "coke", ""}, {"fetch it", "pick", "coke", ""}, {"shove", "push", "milk", ""}};
  options.episodes = 9;
  const CampaignSpec spec = EvaluationSpec(base, options);
  ASSERT_TRUE(spec.Validate()) << spec.Validate().error().message;
  EXPECT_EQ(spec.tasks, (std::vector<std::string>{"push", "pick"}));
  EXPECT_TRUE(spec.task_weights.empty());
  std::map<std::string, int> said;
  for (std::uint64_t i = 0; i < spec.episodes; ++i) ++said[PlanEpisode(spec, i, 0).sentence];
  EXPECT_EQ(said, (std::map<std::string, int>{{"shove it", 3}, {"fetch it", 3}, {"shove", 3}}));
}

}  // namespace evaluation_test
}  // namespace etude::cli
