// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/campaign_spec.cc
#include "services/spec/campaign_spec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "services/core/config_reference.h"
#include "services/spec/object_names.h"
#include "services/spec/task_name.h"
#include "tests/support/matchers.h"

namespace etude {
namespace {

TEST(CampaignSpec, SaysOfEveryKeyWhatItMeansAndInWhichUnit) {
  EXPECT_THAT(MissingFromReference(ConfigReference<CampaignSpec>()), testing::IsEmpty());
}

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

std::map<std::string, int> SplitCounts(const CampaignSpec& spec, std::uint64_t from, std::uint64_t count) {
  std::map<std::string, int> counts;
  for (std::uint64_t i = from; i < from + count; ++i) ++counts[SplitOf(spec, i)];
  return counts;
}

TEST(CampaignSpec, WholeNumbersSplitExactly) {
  struct Row {
    SplitSpec split;
    std::uint64_t block;
  };
  for (const Row& row : {Row{{1600, 400, 400}, 6}, Row{{320, 80, 80}, 6}, Row{{260, 80, 0}, 17}, Row{{200, 400, 0}, 3},
                         Row{{3000, 600, 0}, 6}, Row{{7, 0, 3}, 10}, Row{{0, 5, 0}, 1}}) {
    CampaignSpec spec;
    spec.split = row.split;
    const auto [train, valid, test] = spec.split;
    EXPECT_EQ(SplitBlock(spec.split), row.block);
    for (const std::uint64_t seed : {1, 2, 99}) {
      spec.seed = seed;
      const auto total = static_cast<std::uint64_t>(train + valid + test);
      auto counts = SplitCounts(spec, 0, total);
      EXPECT_EQ(counts["train"], train);
      EXPECT_EQ(counts["valid"], valid);
      EXPECT_EQ(counts["test"], test);
      counts = SplitCounts(spec, 5 * row.block, row.block);
      EXPECT_EQ(counts["train"] * static_cast<int>(total / row.block), train) << "each block by itself";
    }
  }
}

TEST(CampaignSpec, ExactSplitsAreDrawnAnewInEachBlockAndFollowTheSeed) {
  CampaignSpec spec, other_seed, longer;
  spec.split = other_seed.split = longer.split = {4, 1, 1};
  other_seed.seed = 2;
  longer.episodes = 10 * spec.episodes;
  std::map<std::uint64_t, int> test_at;  // place in its block -> how often
  int differ = 0;
  for (std::uint64_t i = 0; i < 6000; ++i) {
    EXPECT_EQ(SplitOf(spec, i), SplitOf(longer, i));
    differ += SplitOf(spec, i) != SplitOf(other_seed, i);
    if (SplitOf(spec, i) == "test") ++test_at[i % 6];
  }
  EXPECT_GT(differ, 2000);
  ASSERT_EQ(test_at.size(), 6u) << "every place of a block";
  for (const auto& [place, count] : test_at) EXPECT_NEAR(count, 1000.0 / 6, 60) << place;
}

TEST(CampaignSpec, FractionsAndHugeBlocksAreDrawnOneByOne) {
  EXPECT_EQ(SplitBlock({0.9, 0.1, 0}), 0u);
  EXPECT_EQ(SplitBlock({90.5, 9.5, 0}), 0u);
  EXPECT_EQ(SplitBlock({99'991, 7, 0}), 0u) << "no block of 99,998";
  CampaignSpec spec;
  spec.split = {99'991, 7, 0};
  EXPECT_EQ(SplitOf(spec, 3), SplitOf(spec, 3));
}

TEST(CampaignSpec, OneObjectOfAClassAtMost) {
  CampaignSpec spec;
  spec.objects = {"apple_00", "apple_01", "mug_00"};
  EXPECT_THAT(spec.Validate(), MessageHas("one of each at most"));
  spec.objects_per_scene = 2;
  spec.tasks = {"pick", "place_left"};
  EXPECT_THAT(spec.Validate(), IsOk());
  spec.objects = {"apple_00", "apple_01"};
  EXPECT_THAT(spec.Validate(), MessageHas("2 on the table of 1 classes")) << "nothing to put it beside";
}

}  // namespace
}  // namespace etude
