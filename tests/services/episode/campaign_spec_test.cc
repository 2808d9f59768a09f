// SPDX-License-Identifier: Apache-2.0
// Tests services/episode/campaign_spec.cc
#include "services/episode/campaign_spec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "tests/support/matchers.h"

namespace etude {
namespace {

TEST(CampaignSpec, DefaultsAreValid) { EXPECT_THAT(CampaignSpec().Validate(), IsOk()); }

TEST(CampaignSpec, ReportsAllProblemsAtOnceWithTheNearestName) {
  CampaignSpec spec;
  spec.tasks = {"pik"};
  spec.image_stride = 0;
  spec.name = "../evil";

  const Status status = spec.Validate();

  EXPECT_THAT(status, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(status, MessageHas("did you mean 'pick'"));
  EXPECT_THAT(status, MessageHas("image_stride"));
  EXPECT_THAT(status, MessageHas("name"));
}

TEST(CampaignSpec, HashIgnoresOnlyWhatMayGrow) {
  const CampaignSpec spec;
  CampaignSpec longer = spec;
  longer.episodes = 7;
  longer.name = "other";
  longer.max_attempts = 3;
  longer.split.train = 0.5;
  CampaignSpec other_seed = spec;
  other_seed.seed = 2;
  CampaignSpec other_camera = spec;
  other_camera.camera.position[1] += 1e-9;

  EXPECT_EQ(SpecHash(spec), SpecHash(longer));
  EXPECT_NE(SpecHash(spec), SpecHash(other_seed));
  EXPECT_NE(SpecHash(spec), SpecHash(other_camera));
}

TEST(CampaignSpec, WeightsGiveExactCounts) {
  CampaignSpec spec;
  spec.task_weights = {4, 3, 3};

  std::map<std::string, int> counts;
  for (std::uint64_t i = 0; i < 80; ++i) ++counts[TaskOf(spec, i)];

  EXPECT_EQ(counts["pick"], 32);
  EXPECT_EQ(counts["push"], 24);
  EXPECT_EQ(counts["put_down"], 24);
}

TEST(CampaignSpec, SplitsAreStableAndNearTheirFractions) {
  CampaignSpec spec;
  CampaignSpec longer = spec;
  longer.episodes = 10 * spec.episodes;

  int valid = 0;
  for (std::uint64_t i = 0; i < 5000; ++i) {
    EXPECT_EQ(SplitOf(spec, i), SplitOf(longer, i));
    valid += SplitOf(spec, i) == "valid" ? 1 : 0;
  }

  EXPECT_NEAR(valid / 5000.0, 0.1, 0.02);
}

TEST(CampaignSpec, SeedsDifferByIndexAndAttempt) {
  const CampaignSpec spec;

  EXPECT_NE(EpisodeSeed(spec, 1, 0), EpisodeSeed(spec, 0, 1));
  EXPECT_EQ(EpisodeSeed(spec, 1, 0), EpisodeSeed(spec, 1, 0));
}

}  // namespace
}  // namespace etude
