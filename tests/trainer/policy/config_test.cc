// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/config.cc and the presets in trainer/experiments/policies.
#include "trainer/policy/config.h"

#include <gmock/gmock.h>

namespace etude::policy {
namespace {

using testing::HasSubstr;

PolicyConfig Preset(const std::string& name) {
  const auto config = LoadConfig<PolicyConfig>("trainer/experiments/policies/" + name + ".yaml");
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
  Module(config, "EE2D").attend = {"image@ee_pixl"};
  Module(config, "DISP").decoder.target = "displacment";

  const std::string problems = Problems(config);

  EXPECT_THAT(problems, HasSubstr("heads: 5 does not divide width 64"));
  EXPECT_THAT(problems, HasSubstr("attention: 'sparse' is not one of module, shared"));
  EXPECT_THAT(problems, HasSubstr("image.layers[0].kernel: must be odd"));
  EXPECT_THAT(problems, HasSubstr("modules.TAR2D.query: unknown module 'LANGE', did you mean 'LANG'?"));
  EXPECT_THAT(problems, HasSubstr("unknown pixel label 'ee_pixl', did you mean 'ee_pixel'?"));
  EXPECT_THAT(problems, HasSubstr("unknown label 'displacment', did you mean 'displacement'?"));
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
  Module(config, "CTRL").decoder.inputs = {"register", "pixel:EE3D",  "soft_argmax", "waves:class:LANG",
                                           "position", "joints:EE3D", "speed:EE3D"};
  const std::string problems = Problems(config);
  EXPECT_THAT(problems, HasSubstr("'pixel:EE3D': that module decodes no pixel"));
  EXPECT_THAT(problems, HasSubstr("'soft_argmax': that module does not read the image"));
  EXPECT_THAT(problems, HasSubstr("'waves:class:LANG': waves are of a position, displacement or joints"));
  EXPECT_THAT(problems, HasSubstr("'position' must name a module"));
  EXPECT_THAT(problems, HasSubstr("'joints:EE3D' belongs to no module"));
  EXPECT_THAT(problems, HasSubstr("unknown input 'speed'"));
}

TEST(PolicyConfig, RefusesAttentionToWhatIsNotRead) {
  PolicyConfig config = Preset("compact");
  Module(config, "LANG").attend = {"image@target_pixel"};
  EXPECT_THAT(Problems(config), HasSubstr("modules.LANG.attend: unknown key 'image'"));
}

TEST(PolicyConfig, RefusesNamesThatMeanSomethingElse) {
  PolicyConfig config = Preset("compact");
  Module(config, "LANG").name = "image";
  EXPECT_THAT(Problems(config), HasSubstr("'image' is not a module's name"));
  config = Preset("compact");
  Module(config, "EE3D").name = "EE2D";
  EXPECT_THAT(Problems(config), HasSubstr("modules.EE2D.name: stands twice"));
}

TEST(PolicyConfig, RefusesRelativeToWithoutAPosition) {
  PolicyConfig config = Preset("compact");
  Module(config, "CTRL").decoder.relative_to = "LANG";
  EXPECT_THAT(Problems(config), HasSubstr("decoder.relative_to: 'LANG' decodes no position"));
  Module(config, "CTRL").decoder.relative_to = "";
  Module(config, "EE3D").decoder.relative_to = "EE2D";
  EXPECT_THAT(Problems(config), HasSubstr("modules.EE3D.decoder.relative_to: is for trajectories only"));
}

TEST(PolicyConfig, RefusesBetweenWithoutTwoPositions) {
  PolicyConfig config = Preset("compact");
  Module(config, "DISP").decoder.between = {"EE3D", "LANG"};
  EXPECT_THAT(Problems(config), HasSubstr("modules.DISP.decoder.between: 'LANG' decodes no position"));
  Module(config, "DISP").decoder.between = {"EE3D"};
  EXPECT_THAT(Problems(config), HasSubstr("modules.DISP.decoder.between: needs two modules, not 1"));
  Module(config, "TAR3D").decoder.between = {"EE3D", "EE3D"};
  EXPECT_THAT(Problems(config), HasSubstr("modules.TAR3D.decoder.between: is for displacements only"));
}

TEST(PolicyConfig, UnknownKeysAreRefused) {
  const auto config =
      LoadConfig<PolicyConfig>("trainer/experiments/policies/compact.yaml", {"image.crop=[0,0,64,64]", "widht=32"});
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

}  // namespace
}  // namespace etude::policy
