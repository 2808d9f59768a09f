// SPDX-License-Identifier: Apache-2.0
// Tests trainer/checkpoint/readiness.cc
#include "trainer/checkpoint/readiness.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/trainer/policy/fixtures.h"

namespace etude::checkpoint {
namespace readiness_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

Metadata Trained() {
  Metadata metadata;
  metadata.run = "demo";
  metadata.step = 100;
  metadata.policy = policy::TinyConfig();
  for (const auto& module : metadata.policy.modules) metadata.modules[module.name] = {100, 0.5};
  return metadata;
}

TEST(ControlPath, HoldsWhatTheTrajectoryDependsOn) {
  auto config = policy::TinyConfig();
  EXPECT_THAT(ControlPath(config), ElementsAre("LANG", "EE2D", "TAR2D", "EE3D", "TAR3D", "DISP", "CTRL"));

  // a control module that looks at the hand only
  auto* control = policy::FindModule(config, "CTRL");
  control->reads = {"joints"};
  control->decoder.inputs = {"register"};
  EXPECT_THAT(ControlPath(config), ElementsAre("EE2D", "EE3D", "CTRL"));

  std::erase_if(config.modules, [](const auto& module) { return module.name == "CTRL"; });
  EXPECT_TRUE(ControlPath(config).empty());
}

TEST(CheckTrained, RefusesWhatWasNeverTrainedOrNeverMeasured) {
  EXPECT_TRUE(CheckTrained(Trained()));
  auto untrained = Trained();
  untrained.modules["CTRL"].trained_steps = 0;
  const Status refused = CheckTrained(untrained);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Code::kUnavailable);
  for (const char* part : {"run 'demo'", "step 100", "CTRL has 0 trained steps"})
    EXPECT_THAT(refused.error().message, HasSubstr(part));

  auto unmeasured = Trained();
  unmeasured.modules["DISP"].error.reset();
  EXPECT_EQ(WhyUntrained(unmeasured), "DISP has no validation error");

  auto missing = Trained();
  missing.modules.erase("LANG");
  EXPECT_EQ(WhyUntrained(missing), "LANG has 0 trained steps");
}

// it decodes nothing: there is nothing to measure, only to train
TEST(CheckTrained, AModuleThatSaysNothingNeedsNoError) {
  auto metadata = Trained();
  policy::FindModule(metadata.policy, "DISP")->decoder.quantity.clear();
  auto* control = policy::FindModule(metadata.policy, "CTRL");
  control->decoder.inputs = {"register", "register:DISP"};
  metadata.modules["DISP"].error.reset();
  EXPECT_EQ(WhyUntrained(metadata), "");
  metadata.modules["DISP"].trained_steps = 0;
  EXPECT_EQ(WhyUntrained(metadata), "DISP has 0 trained steps");
}

TEST(CheckTrained, EveryReasonIsGivenInTheOrderOfTheModules) {
  auto metadata = Trained();
  metadata.modules["CTRL"].error.reset();
  metadata.modules["EE3D"] = {};
  metadata.modules.erase("TAR2D");
  EXPECT_EQ(WhyUntrained(metadata),
            "TAR2D has 0 trained steps; EE3D has 0 trained steps; CTRL has no validation error");
}

TEST(CheckTrained, APolicyThatDrivesNothingMayNotDrive) {
  auto metadata = Trained();
  std::erase_if(metadata.policy.modules, [](const auto& module) { return module.name == "CTRL"; });
  EXPECT_EQ(WhyUntrained(metadata), "no module decodes a trajectory");
  EXPECT_FALSE(CheckTrained(metadata));
}

TEST(CheckTrained, LooksAtTheControlPathOnly) {
  auto metadata = Trained();
  auto* control = policy::FindModule(metadata.policy, "CTRL");
  control->reads = {"joints"};
  control->decoder.inputs = {"register"};
  metadata.modules["TAR3D"] = {};
  EXPECT_EQ(WhyUntrained(metadata), "");
}

TEST(NotBegun, AreModulesThatCountNoStepAndWereNeverMeasured) {
  auto metadata = Trained();
  EXPECT_THAT(NotBegun(metadata.policy, metadata.modules), IsEmpty());

  metadata.modules["CTRL"] = {};
  metadata.modules.erase("TAR2D");
  EXPECT_THAT(NotBegun(metadata.policy, metadata.modules), ElementsAre("CTRL", "TAR2D"));

  // its level was in training, or nobody would have measured it
  metadata.modules["CTRL"].error = 0.5;
  EXPECT_THAT(NotBegun(metadata.policy, metadata.modules), ElementsAre("TAR2D"));
}

TEST(NotBegun, NothingIsAskedOfAModuleWithoutALoss) {
  auto metadata = Trained();
  for (const char* module : {"TAR2D", "DISP"}) {
    policy::FindModule(metadata.policy, module)->decoder.quantity.clear();
    metadata.modules[module] = {};
  }
  EXPECT_THAT(NotBegun(metadata.policy, metadata.modules), ElementsAre("TAR2D")) << "it is told where to look";
}

TEST(NotBegun, IsNotKnownWhereNoStepsAreCounted) {
  auto metadata = Trained();
  for (auto& [module, record] : metadata.modules) record = {};
  EXPECT_THAT(NotBegun(metadata.policy, metadata.modules), IsEmpty());
  EXPECT_THAT(NotBegun(metadata.policy, {}), IsEmpty());
}

}  // namespace readiness_test
}  // namespace etude::checkpoint
