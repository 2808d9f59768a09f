// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/trace.cc and the expert's statistics
#include "worker/task/trace.h"

#include <gmock/gmock.h>

#include <map>

#include "services/episode/codec.h"
#include "worker/task/attempt.h"

namespace etude::task {
namespace trace_test {

CampaignSpec QuickSpec() {
  CampaignSpec spec;
  spec.tasks = {"put_down", "pick+obstacle", "push"};
  spec.seed = 21;
  spec.image_stride = 125;
  spec.camera.width = spec.camera.height = 32;
  return spec;
}

TEST(AttemptTrace, ChangesNothing) {
  auto runner = AttemptRunner::Open(QuickSpec());
  ASSERT_TRUE(runner) << runner.error().message;
  int compared = 0;
  for (std::uint64_t index = 0; index < 3; ++index) {
    AttemptTrace trace;
    const AttemptResult traced = runner->Demonstrate(index, 0, {}, &trace).value(),
                        plain = runner->Demonstrate(index, 0).value();
    EXPECT_EQ(traced.outcome, plain.outcome);
    EXPECT_EQ(static_cast<int>(trace.poses.size()), traced.episode.steps());
    if (plain.outcome == AttemptOutcome::kSuccess) {
      EXPECT_EQ(EncodeEpisode(traced.episode), EncodeEpisode(plain.episode));
      ++compared;
    }
  }
  EXPECT_GE(compared, 2) << "episodes that failed are not compared";
}

// How often the expert led the hand through each stage: a push (not supervised) ends one time and begins another.
std::map<std::string, int> TimesLed(const Episode& episode) {
  std::map<std::string, int> times;
  int before = -1;
  for (int t = 0; t < episode.steps(); ++t) {
    const int now = episode.supervise[t] ? episode.phase[t] : -1;
    if (now >= 0 && now != before) ++times[episode.stage_names[now]];
    before = now;
  }
  return times;
}

TEST(PlannerStatistics, CountEachStageOnceForEachTimeItIsDone) {
  CampaignSpec spec = QuickSpec();
  spec.randomization.disturbance_probability = 1;
  auto runner = AttemptRunner::Open(spec);
  ASSERT_TRUE(runner) << runner.error().message;
  int pushes = 0, episodes = 0;
  for (std::uint64_t index = 0; index < 6; ++index) {
    const AttemptResult result = runner->Demonstrate(index, 0).value();
    if (result.outcome != AttemptOutcome::kSuccess) continue;
    ++episodes;
    std::map<std::string, int> planned;
    for (const auto& one : result.episode.details["planned"]) {
      ++planned[one["stage"].get<std::string>()];
      EXPECT_THAT(one["way"].get<std::string>(), testing::AnyOf("line", "detour", "rrt", "field", "field_escaped"));
    }
    const auto led = TimesLed(result.episode);
    for (const auto& [stage, times] : planned) EXPECT_EQ(times, led.at(stage)) << "episode " << index << " " << stage;
    pushes += result.episode.details["pushes"].get<int>();
  }
  EXPECT_GE(episodes, 4);
  EXPECT_GE(pushes, 4) << "stages that are planned again are what this is about";
}

}  // namespace trace_test
}  // namespace etude::task
