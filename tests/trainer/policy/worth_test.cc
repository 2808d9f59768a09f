// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/worth.cc
#include "trainer/policy/worth.h"

#include <gmock/gmock.h>

#include "tests/trainer/policy/fixtures.h"
#include "trainer/policy/answer.h"

namespace etude::policy {
namespace worth_test {

Inputs OneOf(const PolicyConfig& config, const std::string& sentence) {
  Inputs inputs = MakeInputs(config, 1, 1);
  inputs.sentences = {sentence};
  inputs.sentence_index = torch::zeros({1, 1}, torch::kInt64);
  return inputs;
}

std::shared_ptr<Policy> MakeServing(const PolicyConfig& config) {
  const auto policy = MakePolicy(config);
  policy->eval();
  return policy;
}

// Mean distance of the waypoints of two questions that are asked one after the other, m.
double Apart(Policy& policy, const Inputs& a, const Inputs& b) {
  const auto places = [&](const Inputs& inputs) {
    return WaypointTensor(policy.config(), policy.Forward(inputs)).narrow(-1, 0, 3);
  };
  return (places(a) - places(b)).norm(2, -1).mean().item<double>();
}

TEST(WorthOf, IsHowFarThePlanMovesWithoutAWord) {
  const PolicyConfig config = TinyConfig();
  const auto policy = MakeServing(config);
  const torch::NoGradGuard no_grad;
  const Inputs inputs = OneOf(config, "pick up  red can");
  const Worth worth = WorthOf(*policy, inputs);
  const char* const rest[] = {"up red can", "pick red can", "pick up can", "pick up red"};
  const char* const word[] = {"pick", "up", "red", "can"};
  ASSERT_EQ(worth.words.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(worth.words[i].word, word[i]);
    EXPECT_NEAR(worth.words[i].moves, Apart(*policy, inputs, OneOf(config, rest[i])), 2e-6) << word[i];
    EXPECT_GT(worth.words[i].moves, 1e-5) << word[i];
  }
}

// a robot drives what the last of them says
TEST(WorthOf, IsOfTheCorrectedPlan) {
  const PolicyConfig config = CorrectedConfig();
  const auto policy = MakeServing(config);
  const torch::NoGradGuard no_grad;
  const Inputs inputs = OneOf(config, "pick up red can");
  const auto outputs = policy->Forward(inputs);
  EXPECT_TRUE(torch::allclose(outputs.at("CTRL2").decoded.at("trajectory"), outputs.at("CTRL").decoded.at("trajectory"),
                              1e-4, 1e-5))
      << "at first";
  policy->StateTensors().at("modules.CTRL2.decoder.layer2.bias") += 0.1;
  const auto after = policy->Forward(inputs);
  const torch::Tensor driven = WaypointTensor(config, after);
  EXPECT_FALSE(
      torch::allclose(driven.narrow(-1, 0, 3), after.at("CTRL").decoded.at("trajectory")[0][0].narrow(-1, 0, 3)));
  EXPECT_TRUE(torch::equal(driven.narrow(-1, 0, 3), after.at("CTRL2").decoded.at("trajectory")[0][0].narrow(-1, 0, 3)));
  EXPECT_NEAR(WorthOf(*policy, inputs).words.at(0).moves, Apart(*policy, inputs, OneOf(config, "up red can")), 2e-6);
}

TEST(WorthOf, IsHowFarThePlanMovesWithAJointAtItsMean) {
  const PolicyConfig config = TinyConfig();
  const auto policy = MakeServing(config);
  const torch::NoGradGuard no_grad;
  Inputs inputs = OneOf(config, "push the blue box");
  inputs.joints[0][1] = 0.1;  // its mean
  const Worth worth = WorthOf(*policy, inputs);
  ASSERT_EQ(worth.joints.size(), 3u);
  EXPECT_NEAR(worth.joints[1], 0, 2e-6) << "it is where it is on average";
  for (const std::size_t j : {std::size_t{0}, std::size_t{2}}) {
    Inputs without = inputs;
    without.joints = inputs.joints.clone();
    without.joints[0][static_cast<std::int64_t>(j)] = 0.1;
    EXPECT_NEAR(worth.joints[j], Apart(*policy, inputs, without), 2e-6) << j;
    EXPECT_GT(worth.joints[j], 1e-5) << j;
  }
}

TEST(WorthOf, AWordThatNothingReadsIsWorthNothing) {
  PolicyConfig config = TinyConfig();
  for (ModuleConfig& module : config.modules) {
    std::erase(module.reads, "language");
    std::erase(module.attend, "language");
    std::erase(module.decoder.inputs, "language");
  }
  FindModule(config, "CTRL")->reads = {"joints", "EE3D", "TAR3D", "DISP"};
  const auto policy = MakeServing(config);
  const torch::NoGradGuard no_grad;
  const Worth worth = WorthOf(*policy, OneOf(config, "raise it"));
  ASSERT_EQ(worth.words.size(), 2u);
  EXPECT_EQ(worth.words[0].moves, 0);
  EXPECT_EQ(worth.words[1].moves, 0);
  EXPECT_THAT(worth.joints, testing::Contains(testing::Gt(0)));
}

TEST(WorthOf, SentencesOfNothingAndOfVeryMuch) {
  const PolicyConfig config = TinyConfig();
  const auto policy = MakeServing(config);
  const torch::NoGradGuard no_grad;
  EXPECT_TRUE(WorthOf(*policy, OneOf(config, " ")).words.empty());
  EXPECT_EQ(WorthOf(*policy, OneOf(config, "raise")).words.size(), 1u);
  std::string much;
  for (std::size_t i = 0; i < 2 * kMostWords; ++i) much += "very ";
  const Worth worth = WorthOf(*policy, OneOf(config, much + "much"));
  EXPECT_EQ(worth.words.size(), kMostWords);
}

TEST(WorthOf, NothingOfAPolicyThatPlansNothing) {
  PolicyConfig config = TinyConfig();
  std::erase_if(config.modules, [](const ModuleConfig& module) { return module.name == "CTRL"; });
  const auto policy = MakeServing(config);
  const torch::NoGradGuard no_grad;
  const Worth worth = WorthOf(*policy, OneOf(config, "pick up red can"));
  EXPECT_TRUE(worth.words.empty());
  EXPECT_TRUE(worth.joints.empty());
}

}  // namespace worth_test
}  // namespace etude::policy
