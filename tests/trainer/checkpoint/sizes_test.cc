// SPDX-License-Identifier: Apache-2.0
// Tests trainer/checkpoint/sizes.cc
#include "trainer/checkpoint/sizes.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "trainer/policy/policy.h"
#include "trainer/policy/policy_file.h"

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
  const auto before = LeastParameters(config, 7);
  EXPECT_GT(before, 64u * 8u + 3 * 16 * 9 + 2 * 16 * 16 * 9);
  config.language.buckets += 10;
  EXPECT_EQ(LeastParameters(config, 7), before + 80);
}

// what a file claims is compared with a number that follows from all that makes a network large
TEST(LeastParameters, IsNeverMoreThanThereAreAndAtLeastHalf) {
  for (const char* preset : {"compact", "paper"})
    for (const char* name : {"base", "obstacle", "multi_obstacle", "relational", "faithful"}) {
      const std::string file = fmt::format("{}/{}", preset, name);
      if (!std::filesystem::exists("trainer/experiments/policies/" + file + ".yaml")) continue;
      const auto map = policy::ReadPolicyMap(file, {"trainer/experiments/policies"});
      ASSERT_TRUE(map) << map.error().message;
      auto config = FromJson<policy::PolicyConfig>(*map, file);
      ASSERT_TRUE(config) << config.error().message;
      if (config->image.crop.empty()) config->image.crop = {0, 0, 64, 48};
      config->tasks = {"pick", "push"};
      for (const int joints : {7, 15}) {
        const auto policy = policy::Policy::Create(*config, policy::Normalization::Unit(joints), 1);
        ASSERT_TRUE(policy) << policy.error().message;
        std::uint64_t numbers = 0;
        for (const auto& parameter : (*policy)->parameters()) numbers += static_cast<std::uint64_t>(parameter.numel());
        const std::uint64_t least = LeastParameters(*config, joints);
        EXPECT_LE(least, numbers) << file;
        EXPECT_GE(2 * least, numbers) << file;
      }
    }
}

// before, its inputs and outputs were not counted: 100 000 objects and a hidden layer of 65536 were built
TEST(CheckSizes, CountsWhatDecodersReadAndSay) {
  auto config = Small();
  policy::ModuleConfig module{.name = "LANG"};
  module.decoder = {.entity = "target", .quantity = "class", .readout = "mlp", .hidden = {65536}};
  config.modules.push_back(module);
  for (int i = 0; i < 4000; ++i) config.objects.push_back(fmt::format("object{}", i));
  EXPECT_GT(LeastParameters(config, 7), 65536u * 4000u);
  EXPECT_THAT(CheckSizes(config, 7, 1'000'000).error().message, HasSubstr("the file holds 1000000"));
  EXPECT_THAT(CheckSizes(Small(), -1, 1'000'000).error().message, HasSubstr("embodiment.joints -1"));
}

TEST(CheckSizes, RefusesWhatTheFileDoesNotHold) {
  auto config = Small();
  EXPECT_TRUE(CheckSizes(config, 7, 1'000'000));
  EXPECT_FALSE(CheckSizes(config, 7, 1000));
  config.language.buckets = 1 << 24;
  config.language.width = 4096;
  const Status claimed = CheckSizes(config, 7, 1'000'000);
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
    const Status refused = CheckSizes(config, 7, 1'000'000);
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().message, HasSubstr("crop"));
  }
  auto config = Small();
  config.image.crop = {0, 0, 4096, 4096};
  EXPECT_THAT(CheckSizes(config, 7, 1'000'000).error().message, HasSubstr("tokens"));
}

}  // namespace sizes_test
}  // namespace etude::checkpoint
