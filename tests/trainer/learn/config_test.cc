// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/config.cc and the shipped experiments
#include "trainer/learn/config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/config_reference.h"
#include "tests/support/temporary_folder.h"

namespace etude::learn {
namespace {

using ::testing::HasSubstr;

const Path kExperiments = "trainer/experiments";

TEST(TrainConfig, SaysOfEveryKeyWhatItMeansAndInWhichUnit) {
  EXPECT_THAT(MissingFromReference(ConfigReference<TrainConfig>()), testing::IsEmpty());
}

TEST(LoadTrainConfig, ReadsTheShippedExperimentsWithTheirPolicies) {
  for (const char* name : {"compact", "paper"}) {
    const auto config = LoadTrainConfig(name, kExperiments, {});
    ASSERT_TRUE(config) << config.error().message;
    EXPECT_EQ(config->policy.name, name);
    EXPECT_GE(config->policy.modules.size(), 7u);
  }
}

TEST(LoadTrainConfig, OverridesInsideTheNamedPolicy) {
  const auto config =
      LoadTrainConfig("compact", kExperiments, {"policy.width=48", "optimizer.lr=1e-4", "data.batch=7"});
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_EQ(config->policy.width, 48);
  EXPECT_EQ(config->optimizer.lr, 1e-4);
  EXPECT_EQ(config->data.batch, 7);

  const auto other = LoadTrainConfig("compact", kExperiments, {"policy=paper"});
  ASSERT_TRUE(other) << other.error().message;
  EXPECT_EQ(other->policy.name, "paper");
}

TEST(LoadTrainConfig, ReadsBackItsOwnResolvedFile) {
  const TemporaryFolder folder;
  const auto config = LoadTrainConfig("compact", kExperiments, {"policy.width=48", "seed=9"});
  ASSERT_TRUE(config);
  ASSERT_TRUE(WriteFileAtomically(folder / "config.yaml", ToYaml(ToJson(*config))));

  const auto again = LoadTrainConfig((folder / "config.yaml").string(), kExperiments, {});

  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(ToJson(*again), ToJson(*config));
}

TEST(LoadTrainConfig, RefusesWhatItDoesNotKnowByName) {
  const auto typo = LoadTrainConfig("compact", kExperiments, {"optimiser.lr=1"});
  EXPECT_THAT(typo.error().message, HasSubstr("did you mean 'optimizer'"));
  const auto name = LoadTrainConfig("compakt", kExperiments, {});
  EXPECT_EQ(name.error().code, Code::kInvalidArgument);
  EXPECT_THAT(name.error().message, HasSubstr("compact"));
  const auto policy = LoadTrainConfig("compact", kExperiments, {"policy=papr"});
  EXPECT_THAT(policy.error().message, HasSubstr("paper"));
}

TEST(LoadTrainConfig, NamesAllProblemsAtOnce) {
  const auto config = LoadTrainConfig("compact", kExperiments,
                                      {"optimizer.lr=-1", "data.batch=0", "curriculum.patience=0", "freeze=[NONE]"});
  ASSERT_FALSE(config);
  for (const char* part : {"optimizer.lr", "data.batch", "curriculum.patience", "NONE"})
    EXPECT_THAT(config.error().message, HasSubstr(part));
}

TEST(FindExperiments, LooksAboveTheProgram) {
  const TemporaryFolder folder;
  ASSERT_TRUE(MakeFolders(folder / "trainer/experiments"));
  ASSERT_TRUE(MakeFolders(folder / "build/x/bin"));

  EXPECT_EQ(FindExperiments("", folder / "build/x/bin/etude-trainer").value(), folder / "trainer/experiments");
  EXPECT_EQ(FindExperiments((folder / "trainer").string(), "/x").value(), folder / "trainer/experiments");
  EXPECT_EQ(FindExperiments((folder / "build").string(), "/x").error().code, Code::kNotFound);
}

}  // namespace
}  // namespace etude::learn
