// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/parts.cc and the parts of policy.cc
#include "trainer/policy/parts.h"

#include <gmock/gmock.h>

#include <set>

#include "tests/trainer/policy/fixtures.h"

namespace etude::policy {
namespace parts_test {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

class PartsOfBoth : public BothAttentions {};
INSTANTIATE_TEST_SUITE_P(Parts, PartsOfBoth, testing::Values("module", "shared"));

TEST_P(PartsOfBoth, EveryParameterBelongsToExactlyOnePart) {
  const auto policy = MakePolicy(config_);
  const auto parts = PartsOf(config_);
  std::multiset<std::string> found;
  for (const auto& part : parts)
    for (const auto& name : policy->ParametersOf(part)) found.insert(name);

  const std::set<std::string> distinct(found.begin(), found.end());
  EXPECT_EQ(found.size(), distinct.size());
  EXPECT_EQ(found.size(), policy->named_parameters().size());
  EXPECT_EQ(std::set<std::string>(parts.begin(), parts.end()).size(), parts.size());
  for (const auto& item : policy->named_buffers())
    EXPECT_EQ(PartOfTensor(item.key()).empty(), item.key().starts_with("normalization_")) << item.key();
}

TEST(Parts, OfSharedAttentionAreItsLevelsToo) {
  PolicyConfig config = TinyConfig();
  EXPECT_THAT(PartsOf(config),
              ElementsAre("image", "language", "joints", "LANG", "EE2D", "TAR2D", "EE3D", "TAR3D", "DISP", "CTRL"));
  config.attention = "shared";
  EXPECT_THAT(PartsOf(config), testing::IsSupersetOf({"attention1", "attention2", "attention5"}));
  EXPECT_EQ(PartOfTensor("attention2.key_weight"), "attention2");
  EXPECT_EQ(PartOfTensor("segments.LANG"), "LANG");
  EXPECT_EQ(PartOfTensor("image_key_head.linear.weight"), "image");
}

TEST(Parts, KnowWhatAModuleReads) {
  const PolicyConfig config = TinyConfig();
  const auto of = [&](const char* name) {
    PolicyConfig copy = config;
    return ReadParts(config, *FindModule(copy, name));
  };
  EXPECT_THAT(of("LANG"), ElementsAre("language", "joints"));
  EXPECT_THAT(of("TAR2D"), ElementsAre("image", "LANG"));
  EXPECT_THAT(of("DISP"), ElementsAre("EE3D", "TAR3D", "language"));
}

TEST(Parts, KnowWhichStatisticsTheyComputeWith) {
  PolicyConfig config = TinyConfig();
  EXPECT_THAT(StatisticsOf(config, "joints"), ElementsAre("joint"));
  for (const char* none : {"image", "language", "LANG", "TAR2D"})
    EXPECT_THAT(StatisticsOf(config, none), IsEmpty()) << none;
  EXPECT_THAT(StatisticsOf(config, "EE3D"), ElementsAre("position"));  // a pose
  EXPECT_THAT(StatisticsOf(config, "TAR3D"), ElementsAre("position"));
  EXPECT_THAT(StatisticsOf(config, "DISP"), ElementsAre("displacement", "position"));
  EXPECT_THAT(StatisticsOf(config, "CTRL"), ElementsAre("displacement", "offset"));  // relative waypoints
  DecoderConfig& absolute = FindModule(config, "CTRL")->decoder;
  absolute.readout = "mlp";
  absolute.inputs = {"register", "fourier:displacement:DISP"};
  EXPECT_THAT(StatisticsOf(config, "CTRL"), ElementsAre("offset", "position"));
}

TEST(Parts, AreCheckedByName) {
  const PolicyConfig config = TinyConfig();
  EXPECT_TRUE(CheckParts(config, "init.copy", {"image", "CTRL"}));
  const Status typo = CheckParts(config, "init.copy", {"TAR2B"});
  ASSERT_FALSE(typo);
  EXPECT_THAT(typo.error().message, HasSubstr("init.copy"));
  EXPECT_THAT(typo.error().message, HasSubstr("did you mean 'TAR2D'"));
}

TEST(Parts, TellColumnsOfOneInput) {
  EXPECT_TRUE(IsOfOneInput("modules.CTRL.decoder.from.position:TAR3D"));
  EXPECT_TRUE(IsOfOneInput("modules.CTRL.segments.DISP"));
  EXPECT_FALSE(IsOfOneInput("modules.CTRL.decoder.bias"));
  EXPECT_FALSE(IsOfOneInput("segments.CTRL"));
}

// a step of gradient descent with batch statistics of other pictures moves everything but what is frozen
TEST(Freeze, KeepsPartsBitForBit) {
  PolicyConfig config = TinyConfig();
  const auto policy = MakePolicy(config);
  policy->train();
  policy->Freeze({"image", "TAR2D"});
  std::map<std::string, torch::Tensor> before;
  for (const auto& [name, tensor] : policy->StateTensors()) before[name] = tensor.detach().clone();

  policy->eval();
  policy->train();  // as after a validation
  const Inputs inputs = MakeInputs(config, 4, 2);
  policy->Loss(inputs, policy->Forward(inputs), MakeLabels(config, 4, 2)).total.backward();
  const torch::NoGradGuard no_grad;
  int moved = 0;
  for (auto& item : policy->named_parameters())
    if (item.value().grad().defined()) item.value().sub_(0.1 * item.value().grad()), ++moved;

  EXPECT_GT(moved, 10);
  for (const auto& [name, tensor] : policy->StateTensors()) {
    const std::string part = PartOfTensor(name);
    if (part == "image" || part == "TAR2D") {
      EXPECT_TRUE(torch::equal(tensor, before.at(name))) << name;
    }
  }
  EXPECT_FALSE(torch::equal(policy->StateTensors().at("modules.LANG.register"), before.at("modules.LANG.register")));
  EXPECT_THAT(policy->frozen(), ElementsAre("TAR2D", "image"));
}

TEST(Freeze, KeepsAModulesOwnImageEncoderBitForBit) {
  PolicyConfig config = TinyConfig();
  FindModule(config, "TAR2D")->own_image = true;
  const auto policy = MakePolicy(config);
  policy->train();
  policy->Freeze({"TAR2D"});
  std::map<std::string, torch::Tensor> before;
  for (const auto& item : policy->named_buffers()) before[item.key()] = item.value().clone();
  (void)policy->Forward(MakeInputs(config, 4, 2));
  int own = 0;
  for (const auto& item : policy->named_buffers()) {
    if (!item.key().ends_with("running_mean")) continue;
    const bool frozen = PartOfTensor(item.key()) == "TAR2D";
    EXPECT_EQ(torch::equal(item.value(), before.at(item.key())), frozen) << item.key();
    own += frozen;
  }
  EXPECT_GT(own, 0);
  EXPECT_THAT(ReadParts(config, *FindModule(config, "TAR2D")), Not(Contains("image")));
}

TEST(Freeze, ThawedEncodersMoveTheirStatistics) {
  const PolicyConfig config = TinyConfig();
  const auto policy = MakePolicy(config);
  policy->train();
  std::map<std::string, torch::Tensor> before;
  for (const auto& item : policy->named_buffers()) before[item.key()] = item.value().clone();
  (void)policy->Forward(MakeInputs(config, 4, 2));
  int moved = 0;
  for (const auto& item : policy->named_buffers()) moved += !torch::equal(item.value(), before.at(item.key()));
  EXPECT_GT(moved, 0);
  EXPECT_THAT(policy->frozen(), IsEmpty());
}

// the encoder alone sees joints: another arm needs another encoder and nothing else
TEST(JointToken, HidesHowManyJointsThereAre) {
  PolicyConfig config = TinyConfig();
  config.joint_fourier = true;
  FindModule(config, "EE3D")->decoder.inputs = {"register", "joint_token"};
  FindModule(config, "TAR3D")->decoder.inputs = {"register", "position:EE3D"};
  ASSERT_TRUE(config.Validate());
  const auto six = MakePolicy(config, 1, 6), nine = MakePolicy(config, 1, 9);
  const auto other = nine->StateTensors();
  for (const auto& [name, tensor] : six->StateTensors()) {
    const bool of_joints = PartOfTensor(name) == "joints" || name.starts_with("normalization_joint_");
    if (!of_joints) {
      EXPECT_EQ(tensor.sizes(), other.at(name).sizes()) << name;
    }
  }
  const Inputs inputs = MakeInputs(config, 2, 2, 9);
  EXPECT_EQ(nine->Forward(inputs).at("EE3D").decoded.at("pose").size(0), 2);
}

}  // namespace parts_test
}  // namespace etude::policy
