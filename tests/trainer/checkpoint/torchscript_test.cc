// SPDX-License-Identifier: Apache-2.0
// Tests trainer/checkpoint/torchscript.cc: opened as a program would that has libtorch and nothing of ours.
#include "trainer/checkpoint/torchscript.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/script.h>

#include <sstream>

#include "services/episode/viewpoint.h"
#include "tests/support/matchers.h"
#include "tests/trainer/checkpoint/example_checkpoint.h"
#include "tests/trainer/policy/fixtures.h"
#include "trainer/policy/answer.h"

namespace etude::checkpoint {
namespace torchscript_test {

// As a program without anything of ours opens it. @param facts  what is said of it
torch::jit::Module Load(const std::string& bytes, OrderedJson* facts = nullptr) {
  std::istringstream stream(bytes);
  torch::jit::ExtraFilesMap files{{kTorchScriptFacts, ""}};
  torch::jit::Module module = torch::jit::load(stream, c10::nullopt, files);
  if (facts) *facts = OrderedJson::parse(files[kTorchScriptFacts]);
  return module;
}

class TorchScriptOf : public ::testing::TestWithParam<const char*> {};

INSTANTIATE_TEST_SUITE_P(Encoders, TorchScriptOf, ::testing::Values("default", "conv"));

TEST_P(TorchScriptOf, GivesTheSameWaypointsInPlainLibtorch) {
  auto config = policy::TinyConfig();
  config.language.encoder = GetParam();
  const auto example = ExampleCheckpoint(config);
  const auto bytes = ToTorchScript(example);
  ASSERT_THAT(bytes, IsOk());

  OrderedJson facts;
  torch::jit::Module module = Load(*bytes, &facts);

  const auto policy = BuildPolicy(example);
  ASSERT_THAT(policy, IsOk());
  const torch::NoGradGuard no_grad;
  torch::manual_seed(3);
  for (const char* sentence : {"grasp the red one", "push", "put down the green thing over there now please"}) {
    policy::Inputs inputs;
    inputs.images = torch::randint(256, {1, 3, 16, 24}, torch::kUInt8);
    inputs.crop_origin = torch::tensor({10.0F, 20.0F}).view({1, 2});
    inputs.joints = torch::rand({1, kExampleJoints});
    inputs.sentences = {sentence};
    inputs.sentence_index = torch::zeros({1, 1}, torch::kInt64);
    const auto wanted = policy::WaypointTensor((*policy)->config(), (*policy)->Forward(inputs));
    const auto said = module.forward({inputs.images, inputs.joints, TokenIds(sentence, 64)}).toTensor();

    ASSERT_EQ(said.sizes(), wanted.sizes());
    const auto apart = (said - wanted).abs().view({-1, kWaypointSize});
    EXPECT_LE(apart.narrow(1, 0, 3).max().item<double>(), 1e-5) << sentence << ": m";
    EXPECT_LE(apart.narrow(1, 3, kWaypointSize - 3).max().item<double>(), 1e-4) << sentence << ": rotations, gripper";
  }
  EXPECT_EQ(facts["crop"], OrderedJson::parse("[10, 20, 24, 16]"));
  EXPECT_EQ(facts["step"], 100);
  EXPECT_EQ(facts["token_buckets"], 64);
}

TEST(TorchScript, ReadsSensesOfWords) {
  for (const char* encoder : {"default", "conv"}) {
    auto config = policy::TinyConfig();
    config.language.encoder = encoder;
    config.language.senses = true;
    const auto senses = language::Senses::Open().value();
    config.language.sha256 = senses->sha256();
    const auto example = ExampleCheckpoint(config);
    const auto bytes = ToTorchScript(example);
    ASSERT_THAT(bytes, IsOk());
    OrderedJson facts;
    torch::jit::Module module = Load(*bytes, &facts);
    EXPECT_EQ(facts["token_senses"], config.language.sha256);

    const auto picture = torch::randint(256, {1, 3, 16, 24}, torch::kUInt8);
    const auto joints = torch::rand({1, kExampleJoints});
    const auto say = [&](const language::Senses* known) {
      return module.forward({picture, joints, TokenIds("push the flask", 64, known)}).toTensor();
    };
    EXPECT_FALSE(say(senses.get()).equal(say(nullptr))) << encoder;
  }
}

TEST(TorchScript, IsToldTheCameraWhereAModuleReadsIt) {
  auto config = policy::TinyConfig();
  auto& decoder = policy::FindModule(config, "TAR3D")->decoder;
  decoder.readout = "ray";
  decoder.from = {"TAR2D"};
  const auto bytes = ToTorchScript(ExampleCheckpoint(config));
  ASSERT_THAT(bytes, IsOk());
  torch::jit::Module module = Load(*bytes);
  const Viewpoint above = ViewpointOf(40, 40, 24, 24, {{0, 0, 1}, Eigen::Quaterniond::Identity()});
  const auto viewpoint = torch::tensor(std::vector<float>(above.begin(), above.end())).view({1, kViewpointSize});
  const std::vector<torch::jit::IValue> inputs{torch::randint(256, {1, 3, 16, 24}, torch::kUInt8),
                                               torch::rand({1, kExampleJoints}), TokenIds("push", 64)};
  auto told = inputs;
  told.emplace_back(viewpoint);
  const auto here = module.forward(told).toTensor();
  EXPECT_EQ(here.sizes(), (std::vector<std::int64_t>{kWaypoints, kWaypointSize}));
  told.back() = viewpoint * 0.5;
  EXPECT_FALSE(module.forward(told).toTensor().equal(here));
  EXPECT_ANY_THROW(module.forward(inputs));
}

TEST(TorchScript, KeepsWeightsAsParameters) {
  const auto bytes = ToTorchScript(ExampleCheckpoint(policy::TinyConfig()));
  ASSERT_THAT(bytes, IsOk());
  const torch::jit::Module module = Load(*bytes);
  EXPECT_GT(module.parameters().size(), 20u);
}

TEST(TorchScript, RefusesInWords) {
  auto config = policy::TinyConfig();
  config.modules.pop_back();  // CTRL
  EXPECT_THAT(ToTorchScript(ExampleCheckpoint(config)), MessageHas("decodes a trajectory"));

  auto untrained = ExampleCheckpoint(policy::TinyConfig());
  untrained.metadata.modules["DISP"].trained_steps = 0;
  EXPECT_THAT(ToTorchScript(untrained), MessageHas("DISP"));

  auto clip = ExampleCheckpoint(policy::TinyConfig());
  clip.metadata.policy.language.encoder = "clip:/somewhere";
  EXPECT_THAT(ToTorchScript(clip), MessageHas("clip"));
}

TEST(TokenIds, FillUpRowsWithMinusOne) {
  const auto ids = TokenIds("a longerword", 64);
  ASSERT_EQ(ids.dim(), 2);
  EXPECT_EQ(ids.size(0), 2);
  EXPECT_GE(ids.min().item<std::int64_t>(), -1);
  EXPECT_LT(ids.max().item<std::int64_t>(), 64);
  EXPECT_EQ(ids[0][-1].item<std::int64_t>(), -1);
}

}  // namespace torchscript_test
}  // namespace etude::checkpoint
