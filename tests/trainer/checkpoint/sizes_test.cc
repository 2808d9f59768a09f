// SPDX-License-Identifier: Apache-2.0
// Tests trainer/checkpoint/sizes.cc
#include "trainer/checkpoint/sizes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace etude::checkpoint {
namespace sizes_test {

using ::testing::HasSubstr;

policy::PolicyConfig Small() {
  policy::PolicyConfig config;
  config.image.crop = {10, 20, 24, 16};
  config.image.layers = {{.kind = "conv", .channels = 16, .kernel = 3, .stride = 2},
                         {.kind = "residual", .channels = 16}};
  config.width = 8;
  config.language = {.buckets = 64, .width = 8, .hidden = 8};
  return config;
}

TEST(LeastParameters, AddsUpTheLargeMatrices) {
  auto config = Small();
  const auto before = LeastParameters(config);
  EXPECT_GT(before, 64u * 8u + 3 * 16 * 9 + 2 * 16 * 16 * 9);
  config.language.buckets += 10;
  EXPECT_EQ(LeastParameters(config), before + 80);
}

TEST(CheckSizes, RefusesWhatTheFileDoesNotHold) {
  auto config = Small();
  EXPECT_TRUE(CheckSizes(config, 1'000'000));
  EXPECT_FALSE(CheckSizes(config, 1000));
  config.language.buckets = 1 << 24;
  config.language.width = 4096;
  const Status claimed = CheckSizes(config, 1'000'000);
  ASSERT_FALSE(claimed);
  EXPECT_EQ(claimed.error().code, Code::kCorrupt);
  EXPECT_THAT(claimed.error().message, HasSubstr("the file holds 1000000"));
}

TEST(CheckSizes, RefusesACropThatLiesInNoPicture) {
  for (const std::vector<int>& crop : {std::vector<int>{-1, 0, 24, 16},
                                       {0, -20, 24, 16},
                                       {4090, 0, 24, 16},
                                       {0, 2147483647, 24, 16},
                                       {0, 0, 24},
                                       {}}) {
    auto config = Small();
    config.image.crop = crop;
    const Status refused = CheckSizes(config, 1'000'000);
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().message, HasSubstr("crop"));
  }
  auto config = Small();
  config.image.crop = {0, 0, 4096, 4096};
  EXPECT_THAT(CheckSizes(config, 1'000'000).error().message, HasSubstr("tokens"));
}

}  // namespace sizes_test
}  // namespace etude::checkpoint
