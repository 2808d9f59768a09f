// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/upgrade.cc: a policy of schema 1 becomes today's without a change of what it says.
#include "trainer/policy/upgrade.h"

#include <gmock/gmock.h>

#include <cmath>
#include <cstring>

#include "services/core/rng.h"
#include "services/store/safetensors.h"
#include "tests/support/matchers.h"
#include "tests/trainer/policy/fixtures.h"
#include "trainer/policy/answer.h"
#include "trainer/policy/crop.h"
#include "trainer/policy/names.h"

namespace etude::policy {
namespace upgrade_test {

using torch::Tensor;

// TinyConfig as its time wrote it
const std::string kOld = std::string(kTinyEncoders) + R"(
attention_loss: mse
modules:
  - {name: LANG, level: 1, reads: [language, joints], attend: [language],
     decoder: {target: target_class, hidden: [], relative_to: "", between: []}}
  - {name: EE2D, level: 2, reads: [joints, image], attend: ["image@ee_pixel"], decoder: {target: ee_pixel}}
  - {name: EE3D, level: 3, reads: [joints, EE2D], attend: [joints, EE2D],
     decoder: {target: ee_pose, hidden: [8], inputs: [register, "waves:joints"]}}
  - {name: DISP, level: 4, query: "", decoder: {target: displacement, between: [EE3D, EE3D]}}
  - {name: CTRL, level: 5, attend: [language],
     decoder: {target: trajectory, hidden: [12, 12], relative_to: EE3D, inputs: [register, "class:LANG"]}}
)";

PolicyConfig Upgraded() {
  const auto json = UpgradePolicyJson(ParseYaml(kOld, "old").value());
  auto config = FromJson<PolicyConfig>(json, "upgraded");
  EXPECT_TRUE(config) << config.error().message;
  const Status valid = config->Validate();
  EXPECT_TRUE(valid) << valid.error().message;
  return *config;
}

TEST(Upgrade, OfWhatIsNotAsItShouldBeEndsInARefusal) {
  for (const char* json : {R"({"attention_loss": "mse", "losses": 3})", R"({"attention_loss": 3, "losses": "log"})",
                           R"({"attention_loss": "mse", "losses": [1]})", R"({"modules": [3, {"decoder": []}]})",
                           R"({"modules": [{"attend": [1], "decoder": {"target": 3, "between": 7, "inputs": 4}}]})"})
    EXPECT_THAT(FromJson<PolicyConfig>(UpgradePolicyJson(OrderedJson::parse(json)), "hostile"),
                HasCode(Code::kInvalidArgument))
        << json;
}

TEST(Upgrade, KeysBecomeTodaysAndSinesAndCosinesStay) {
  PolicyConfig config = Upgraded();
  EXPECT_EQ(config.losses.attention.kind, "mse");
  const auto decoder = [&](const char* name) { return FindModule(config, name)->decoder; };
  EXPECT_EQ(decoder("LANG").label(), "target.class");
  EXPECT_EQ(decoder("LANG").readout, "linear");
  EXPECT_EQ(FindModule(config, "EE2D")->attend, std::vector<std::string>{"image@ee"});
  EXPECT_EQ(decoder("EE2D").readout, "soft_argmax");
  EXPECT_EQ(decoder("EE3D").rotation, "euler_sincos");
  EXPECT_EQ(decoder("EE3D").readout, "mlp");
  EXPECT_EQ(decoder("EE3D").inputs[1], "fourier:joints");
  EXPECT_EQ(decoder("DISP").label(), "target.displacement");
  EXPECT_EQ(decoder("DISP").from, (std::vector<std::string>{"EE3D", "EE3D"}));
  EXPECT_EQ(decoder("CTRL").label(), "ee.trajectory");
  EXPECT_EQ(decoder("CTRL").readout, "relative");
  EXPECT_EQ(decoder("CTRL").rotation, "euler_sincos");
}

// rows and columns of `tensors` put together again as schema 1 had them
std::map<std::string, Tensor> Downgraded(const PolicyConfig& config, std::map<std::string, Tensor> tensors) {
  const auto take = [&](const std::string& name) { return tensors.extract(name).mapped(); };
  for (const ModuleConfig& module : config.modules) {
    const std::string prefix = "modules." + module.name + ".";
    std::vector<Tensor> rows, columns;
    for (const auto& key : ResolveReads(config, module))
      if (key != "image" && config.attention == "module") rows.push_back(take(prefix + "segments." + key));
    if (!rows.empty()) tensors[prefix + "segments"] = torch::stack(rows);
    for (const auto& input : module.decoder.inputs) columns.push_back(take(prefix + "decoder.from." + input));
    tensors[prefix + "decoder.layer0.weight"] = torch::cat(columns, 1);
    tensors[prefix + "decoder.layer0.bias"] = take(prefix + "decoder.bias");
  }
  if (config.attention == "module") return tensors;
  std::vector<Tensor> rows;
  for (const char* key : {"image", "joints", "language"}) rows.push_back(take(std::string("segments.") + key));
  for (const ModuleConfig* module : EvaluationOrder(config))
    if (module->query.empty()) rows.push_back(take("segments." + module->name));
  tensors["segments"] = torch::stack(rows);
  return tensors;
}

TEST(Upgrade, TablesOfOldWeightsAreFoundByName) {
  for (const char* attention : {"module", "shared"}) {
    PolicyConfig config = Upgraded();
    config.attention = attention;
    const auto policy = MakePolicy(config, 3);
    const auto wanted = policy->StateTensors();
    auto tensors = Downgraded(config, wanted);
    ASSERT_TRUE(tensors.contains("modules.CTRL.decoder.layer0.weight"));
    ASSERT_FALSE(policy->LoadStateTensors(tensors)) << "as it is it does not fit";

    UpgradeStateNames(config, tensors);

    ASSERT_EQ(tensors.size(), wanted.size()) << attention;
    for (const auto& [name, tensor] : wanted) EXPECT_TRUE(torch::equal(tensors.at(name), tensor)) << name;
    EXPECT_TRUE(policy->LoadStateTensors(tensors));
  }
}

// A checkpoint that the program of schema 1 trained.
struct Old {
  PolicyConfig config;
  std::shared_ptr<Policy> policy;
};

Old LoadOld(const std::string& file) {
  const auto stored = store::ReadSafetensors(file + ".safetensors").value();
  const auto json = UpgradePolicyJson(OrderedJson::parse(stored.metadata.at("policy_config")));
  Old old{FromJson<PolicyConfig>(json, file).value(), nullptr};
  std::map<std::string, Tensor> tensors;
  for (const auto& [key, tensor] : stored.tensors) {
    EXPECT_EQ(tensor.dtype, store::DType::kF32) << key;
    tensors[key] = torch::empty(tensor.shape);
    std::memcpy(tensors[key].data_ptr(), tensor.data.data(), tensor.data.size());
  }
  UpgradeStateNames(old.config, tensors);
  old.policy = MakePolicy(old.config, 1, 7);
  const Status loaded = old.policy->LoadStateTensors(tensors);
  EXPECT_TRUE(loaded) << loaded.error().message;
  old.policy->eval();
  return old;
}

// The observation that it answered then: a drawn picture of 48 px, after as many draws as there are joints.
Inputs OldInputs(const PolicyConfig& config, const std::vector<float>& joints) {
  Rng rng(3);
  for (std::size_t i = 0; i < joints.size(); ++i) rng.Uniform(-1, 1);
  std::vector<std::uint8_t> picture(48 * 48 * 3);
  for (auto& pixel : picture) pixel = static_cast<std::uint8_t>(rng.Below(256));
  const codec::Region crop = CropOf(config.image);
  Tensor image = torch::empty({1, crop.height, crop.width, 3}, torch::kUInt8);
  EXPECT_TRUE(codec::CropPicture(picture, 48, 48, crop, {image.data_ptr<std::uint8_t>(), crop.bytes()}));
  return {image.permute({0, 3, 1, 2}),
          torch::tensor({static_cast<float>(crop.u), static_cast<float>(crop.v)}).view({1, 2}),
          {},
          torch::tensor(joints).view({1, -1}),
          {"pick up the red can"},
          {},
          torch::zeros({1, 1}, torch::kInt64)};
}

TEST(Upgrade, OldCheckpointsAnswerAsTheyDid) {
  for (const std::string name : {"compact", "paper"}) {
    SCOPED_TRACE(name);
    const std::string file = "tests/trainer/checkpoint/data/" + name + "-schema1";
    const auto [config, policy] = LoadOld(file);
    const auto answer = OrderedJson::parse(ReadTextFile(file + ".answer.json").value());
    const torch::NoGradGuard no_grad;
    const Outputs outputs = policy->Forward(OldInputs(config, answer["joints"].get<std::vector<float>>()));
    const auto expected = answer["waypoints"].get<std::vector<float>>();
    ASSERT_EQ(expected.size(), 120u);

    // the head says what it said, sines and cosines; what leaves the policy is 6D
    const Tensor said = outputs.at("CTRL").decoded.at("trajectory").flatten().contiguous();
    const auto waypoints = WaypointsOf(config, outputs);
    ASSERT_EQ(waypoints.size(), expected.size());
    for (std::size_t k = 0; k < expected.size(); k += 10) {
      for (std::size_t i = k; i < k + 10; ++i) EXPECT_NEAR(said.data_ptr<float>()[i], expected[i], 1e-5) << i;
      const auto angle = [&](std::size_t i) { return std::atan2(expected[k + 3 + 2 * i], expected[k + 4 + 2 * i]); };
      const Waypoint now = FromVector(&waypoints[k]);
      EXPECT_LT(AngleBetween(now.X_WE.q, FromEuler({angle(0), angle(1), angle(2)})), 1e-3) << k;
      EXPECT_NEAR(now.gripper, expected[k + 9], 1e-5);
    }
    const auto modules = DescribeModules(config, outputs);
    EXPECT_EQ(modules["TAR3D"]["entity"], "target");
    EXPECT_EQ(modules["CTRL"].contains("value"), false);
  }
}

TEST(Upgrade, WhatDoesNotFitIsLeftForTheLoaderToRefuse) {
  const PolicyConfig config = Upgraded();
  std::map<std::string, Tensor> tensors{{"modules.CTRL.decoder.layer0.weight", torch::zeros({12, 5})},
                                        {"modules.CTRL.segments", torch::zeros({3})},
                                        {"normalization_joint_mean", torch::zeros({3})}};
  const auto before = tensors.size();
  UpgradeStateNames(config, tensors);
  EXPECT_EQ(tensors.size(), before);
  EXPECT_FALSE(MakePolicy(config)->LoadStateTensors(tensors));
  for (const char* text : {"null", "[1]", R"({"modules": 3})", R"({"modules": [3]})",
                           R"({"modules": [{"decoder": 1}]})", R"({"modules": [{"decoder": {"target": 7}}]})"}) {
    const auto odd = FromJson<PolicyConfig>(UpgradePolicyJson(OrderedJson::parse(text)), "t");
    EXPECT_FALSE(odd && odd->Validate()) << text;
  }
}

}  // namespace upgrade_test
}  // namespace etude::policy
