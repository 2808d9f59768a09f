// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/config.cc and the presets in trainer/experiments/policies.
#include "trainer/policy/config.h"

#include <gmock/gmock.h>

#include "tests/support/matchers.h"
#include "trainer/policy/architecture.h"
#include "trainer/policy/names.h"

namespace etude::policy {
namespace config_test {

using testing::HasSubstr;

PolicyConfig Preset(const std::string& name) {
  const auto config = LoadConfig<PolicyConfig>("trainer/experiments/policies/" + name + "/base.yaml");
  EXPECT_TRUE(config) << config.error().message;
  return *config;
}

ModuleConfig& Module(PolicyConfig& config, const std::string& name) {
  for (ModuleConfig& module : config.modules)
    if (module.name == name) return module;
  ADD_FAILURE() << name;
  return config.modules[0];
}

std::string Problems(const PolicyConfig& config) {
  const Status status = config.Validate();
  return status ? "" : status.error().message;
}

TEST(PolicyConfig, PresetsAreValid) {
  for (const char* name : {"compact", "paper"}) EXPECT_EQ(Problems(Preset(name)), "") << name;
}

TEST(PolicyConfig, ReportsAllProblemsAtOnceWithTheNearestName) {
  PolicyConfig config = Preset("compact");
  config.heads = 5;
  config.attention = "sparse";
  config.image.layers[0].kernel = 4;
  Module(config, "TAR2D").query = "LANGE";
  Module(config, "EE2D").attend = {"image@targt"};
  Module(config, "EE3D").decoder.entity = "eee";
  Module(config, "DISP").decoder.quantity = "displacment";
  config.losses.pixel.beta = 0;

  const std::string problems = Problems(config);

  EXPECT_THAT(problems, HasAll({"heads: 5 does not divide width 64", "attention: 'sparse' is not one of module, shared",
                                "image.layers[0].kernel: must be odd",
                                "modules.TAR2D.query: unknown module 'LANGE', did you mean 'LANG'?",
                                "modules.EE2D.attend: unknown entity 'targt', did you mean 'target'?",
                                "modules.EE3D.decoder.entity: unknown entity 'eee', did you mean 'ee'?",
                                "unknown quantity 'displacment', did you mean 'displacement'?",
                                "losses.pixel.beta: must be > 0"}));
}

TEST(PolicyConfig, LanguageIsTrainedAlongOrClips) {
  PolicyConfig config = Preset("compact");
  EXPECT_EQ(config.language.clip_folder(), "");
  config.language.encoder = "clip:/models/a b";
  EXPECT_EQ(config.language.clip_folder(), "/models/a b");
  EXPECT_EQ(Problems(config), "");
  config.language.sha256 = std::string(64, 'f');
  EXPECT_EQ(Problems(config), "");
  for (const char* sha256 : {"abc", "FFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFF"}) {
    config.language.sha256 = sha256;
    EXPECT_THAT(Problems(config), HasSubstr("language.sha256")) << sha256;
  }
  config.language.senses = true;
  EXPECT_THAT(Problems(config), HasSubstr("language.senses"));
  config.language = {.encoder = "conv", .senses = true, .sha256 = std::string(64, 'f')};
  EXPECT_EQ(Problems(config), "");
  EXPECT_EQ(config.language.rows(), config.language.buckets + language::kSenseBuckets);
  config.language = {.encoder = "default", .sha256 = std::string(64, 'f')};
  EXPECT_THAT(Problems(config), HasSubstr("language.sha256"));
  for (const char* encoder : {"clip:", "clip", "bert"}) {
    config.language = {.encoder = encoder};
    EXPECT_THAT(Problems(config), HasSubstr("is neither default nor conv nor clip:DIR")) << encoder;
  }
}

TEST(PolicyConfig, RefusesModulesThatAreNotEvaluatedBefore) {
  PolicyConfig config = Preset("compact");
  Module(config, "EE2D").reads = {"image", "EE3D"};
  EXPECT_THAT(Problems(config), HasSubstr("modules.EE2D.reads: 'EE3D' is not evaluated before it (level)"));
}

TEST(PolicyConfig, AModuleMayReadItsOwnLevelOnlyAboveIt) {
  PolicyConfig config = Preset("compact");
  ASSERT_EQ(Module(config, "EE3D").level, Module(config, "TAR3D").level);
  EXPECT_EQ(Problems(config), "");
  Module(config, "EE3D").reads = {"joints", "TAR3D"};
  Module(config, "EE3D").attend = {"joints"};
  EXPECT_THAT(Problems(config), HasSubstr("modules.EE3D.reads: 'TAR3D' is not evaluated before it"));
}

TEST(PolicyConfig, RefusesInputsThatNobodyDecodes) {
  PolicyConfig config = Preset("compact");
  Module(config, "CTRL").decoder.inputs = {"register", "pixel:EE3D",  "soft_argmax", "fourier:class:LANG",
                                           "position", "joints:EE3D", "speed:EE3D"};
  const std::string problems = Problems(config);
  EXPECT_THAT(
      problems,
      HasAll({"'pixel:EE3D': that module decodes no pixel", "'soft_argmax': that module does not read the image",
              "'fourier:class:LANG': Fourier features are of a position, displacement or joints",
              "'position' must name a module", "'joints:EE3D' belongs to no module", "unknown input 'speed'"}));
}

TEST(PolicyConfig, KeysBesideAllAreReadOrRefused) {
  PolicyConfig config = Preset("paper");
  const auto all = ResolveReads(config, Module(config, "CTRL"));
  Module(config, "CTRL").reads = {"all", "TAR3D", "self"};
  EXPECT_EQ(Problems(config), "");
  auto with_self = all;
  with_self.push_back("self");
  EXPECT_EQ(ResolveReads(config, Module(config, "CTRL")), with_self) << "TAR3D is among all";
  Module(config, "CTRL").reads = {"all", "TAR3"};
  EXPECT_THAT(Problems(config), HasSubstr("TAR3"));
  Module(config, "TAR3D").reads = {"all", "CTRL"};
  EXPECT_THAT(Problems(config), HasSubstr("CTRL"));
}

TEST(PolicyConfig, RefusesAttentionToWhatIsNotRead) {
  PolicyConfig config = Preset("compact");
  Module(config, "LANG").attend = {"image@target"};
  EXPECT_THAT(Problems(config), HasSubstr("modules.LANG.attend: unknown key 'image'"));
}

TEST(PolicyConfig, RefusesAKeyThatIsAttendedToTwice) {
  PolicyConfig config = Preset("compact");
  Module(config, "DISP").attend = {"EE3D", "EE3D"};
  EXPECT_THAT(Problems(config), HasSubstr("modules.DISP.attend: a key stands twice"));
}

TEST(PolicyConfig, RefusesNamesThatMeanSomethingElse) {
  PolicyConfig config = Preset("compact");
  Module(config, "LANG").name = "image";
  EXPECT_THAT(Problems(config), HasSubstr("'image' is not a module's name"));
  config = Preset("compact");
  Module(config, "EE3D").name = "EE2D";
  EXPECT_THAT(Problems(config), HasSubstr("modules.EE2D.name: stands twice"));
}

TEST(PolicyConfig, ACorrectionIsOfATrajectoryAndDrives) {
  PolicyConfig config = Preset("compact");
  EXPECT_EQ(DrivingModule(config)->name, "CTRL");
  ModuleConfig added = Module(config, "CTRL");
  added.name = "CTRL2";
  added.decoder.readout = "correction";
  added.decoder.from = {"CTRL"};
  added.decoder.inputs = {"register", "trajectory:CTRL"};
  config.modules.insert(config.modules.end(), added);
  EXPECT_EQ(Problems(config), "");
  EXPECT_EQ(DrivingModule(config)->name, "CTRL2");
  Module(config, "CTRL2").decoder.rotation = "euler_sincos";
  EXPECT_THAT(Problems(config), HasSubstr("modules.CTRL2.decoder.rotation: euler_sincos of what 'CTRL' says in 6d"));
  Module(config, "CTRL2").decoder.from = {"DISP"};
  EXPECT_THAT(Problems(config), HasSubstr("modules.CTRL2.decoder.from: 'DISP' decodes no trajectory"));
  Module(config, "CTRL2").decoder.inputs = {"fourier:trajectory:CTRL"};
  EXPECT_THAT(Problems(config), HasSubstr("Fourier features are of"));
  std::erase_if(config.modules, [](const ModuleConfig& module) { return module.name.starts_with("CTRL"); });
  EXPECT_EQ(DrivingModule(config), nullptr);
}

TEST(PolicyConfig, ReadoutsAreThoseOfTheQuantity) {
  PolicyConfig config = Preset("compact");
  Module(config, "CTRL").decoder.from = {"LANG"};
  EXPECT_THAT(Problems(config), HasSubstr("modules.CTRL.decoder.from: 'LANG' decodes no position"));
  Module(config, "CTRL").decoder.from = {};
  EXPECT_THAT(Problems(config), HasSubstr("modules.CTRL.decoder.from: relative needs 1 modules, not 0"));
  Module(config, "DISP").decoder.from = {"EE3D"};
  EXPECT_THAT(Problems(config), HasSubstr("modules.DISP.decoder.from: difference needs 2 modules, not 1"));
  Module(config, "TAR3D").decoder.readout = "soft_argmax";
  EXPECT_THAT(Problems(config), HasSubstr("modules.TAR3D.decoder.readout: 'soft_argmax' is not one of linear, mlp"));
  Module(config, "TAR3D").decoder.readout = "linear";
  EXPECT_THAT(Problems(config), HasSubstr("modules.TAR3D.decoder.hidden: linear has no hidden layer"));
  Module(config, "TAR2D").decoder.readout = "mlp";
  EXPECT_THAT(Problems(config), HasSubstr("modules.TAR2D.decoder.hidden: mlp needs one"));
}

TEST(PolicyConfig, QuantitiesAreOfEntitiesThatHaveThem) {
  PolicyConfig config = Preset("compact");
  Module(config, "TAR3D").decoder.entity = "others";
  Module(config, "CTRL").decoder.entity = "target";
  Module(config, "LANG").decoder.entity = "ee";
  const std::string problems = Problems(config);
  EXPECT_THAT(problems, HasAll({"modules.TAR3D.decoder: a position is not of 'others'",
                                "modules.CTRL.decoder: a trajectory is not of 'target'",
                                "modules.LANG.decoder: a class is not of 'ee'"}));

  config = Preset("compact");
  Module(config, "TAR3D").decoder.entity = "object:coke";
  Module(config, "TAR2D").attend = {"image@others"};
  EXPECT_EQ(Problems(config), "");
}

TEST(PolicyConfig, LabelsAreThoseThatModulesAskFor) {
  PolicyConfig config = Preset("compact");
  Module(config, "TAR2D").attend = {"image@others"};
  std::vector<std::string> names;
  for (const auto& column : LabelColumnsOf(config)) names.push_back(column.name);
  EXPECT_THAT(names,
              testing::UnorderedElementsAre("target.class", "command.task", "ee.pixel", "target.pixel", "others.pixel",
                                            "ee.position", "target.position", "target.displacement", "ee.trajectory"));
}

TEST(PolicyConfig, MoreThanAnyPolicyNeedsIsRefused) {
  PolicyConfig config = Preset("compact");
  config.modules.resize(300, config.modules.back());
  EXPECT_THAT(Problems(config), HasSubstr("modules: 300 of them, more than 256"));
  config = Preset("compact");
  config.objects.resize(100'000);
  EXPECT_THAT(Problems(config), HasSubstr("objects: 100000 of them"));
  config = Preset("compact");
  Module(config, "CTRL").decoder.hidden.assign(65, 8);
  EXPECT_THAT(Problems(config), HasSubstr("modules.CTRL.decoder.hidden: 65 of them"));
  config = Preset("compact");
  config.image.layers.assign(5, {.kind = "conv", .channels = 8, .kernel = 3, .stride = 8});
  EXPECT_THAT(Problems(config), HasSubstr("their strides make more than 4096 px"));
  config.image.layers.assign(1, {.kind = "conv", .channels = 4096, .kernel = 3, .stride = 1});
  config.image.crop = {0, 0, 4096, 4096};
  EXPECT_THAT(Problems(config), HasSubstr("image.layers[0]: 4096x4096 px of 4096 channels"));
}

TEST(PolicyConfig, UnknownKeysAreRefused) {
  const auto config = LoadConfig<PolicyConfig>("trainer/experiments/policies/compact/base.yaml",
                                               {"image.crop=[0,0,64,64]", "widht=32"});
  ASSERT_FALSE(config);
  EXPECT_THAT(config.error().message, HasSubstr("widht"));
}

TEST(ArchitectureHash, FollowsWhatShapesWeightsOnly) {
  PolicyConfig config = Preset("compact");
  const std::string hash = ArchitectureHash(config);
  EXPECT_EQ(hash.size(), 64U);

  config.name = "other";
  config.precision = "float32";
  Module(config, "CTRL").decoder.weight = 3;
  Module(config, "CTRL").detach = false;
  Module(config, "EE2D").attend.clear();
  EXPECT_EQ(ArchitectureHash(config), hash);

  Module(config, "CTRL").decoder.hidden = {256};
  EXPECT_NE(ArchitectureHash(config), hash);
}

TEST(PolicyConfig, AnOwnImageEncoderIsOfModulesThatLook) {
  PolicyConfig config = Preset("compact");
  Module(config, "TAR2D").own_image = true;
  EXPECT_TRUE(config.Validate());
  Module(config, "DISP").own_image = true;
  EXPECT_THAT(Problems(config), HasSubstr("modules.DISP.own_image: the module does not read the image"));
  Module(config, "DISP").own_image = false;
  config.attention = "shared";
  EXPECT_THAT(Problems(config), HasSubstr("modules.TAR2D.own_image: needs attention: module"));
}

}  // namespace config_test
}  // namespace etude::policy
