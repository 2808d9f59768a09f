// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/evaluate.cc
#include "trainer/learn/evaluate.h"

#include <gtest/gtest.h>

#include "tests/trainer/learn/tiny_run.h"
#include "trainer/data/statistics.h"
#include "trainer/learn/tensors.h"

namespace etude::learn {
namespace evaluate_test {

TEST(Evaluate, MeasuresEveryModuleInUnitsOfPeopleAndLeavesThePolicyTraining) {
  const TemporaryFolder folder;
  const TrainConfig config = TinyConfig();
  auto dataset = TinyDataset(folder / "d", 24);
  ASSERT_TRUE(dataset->Refresh());
  const auto snapshot = dataset->snapshot();
  const auto statistics = data::ComputeStatistics(*snapshot);
  ASSERT_TRUE(statistics);
  auto policy = policy::Policy::Create(config.policy, ToNormalization(*statistics), 1);
  ASSERT_TRUE(policy) << policy.error().message;
  (*policy)->train();
  auto grammar = language::Grammar::Load();
  ASSERT_TRUE(grammar);
  const data::BatchMaker maker(config.data, TinyContent(config.policy, dataset->spec()),
                               std::make_shared<const language::Grammar>(std::move(*grammar)));
  const auto samples = data::SpreadFrames(*snapshot, data::Split::kValid, 1, 20);

  const auto all = Evaluate(**policy, maker, *snapshot, samples, 5, 8);
  const auto again = Evaluate(**policy, maker, *snapshot, samples, 5, 8);
  const auto early = Evaluate(**policy, maker, *snapshot, samples, 2, 8);

  ASSERT_TRUE(all) << all.error().message;
  for (const char* name : {"LANG.accuracy", "EE2D.px", "TAR2D.px", "TAR2D.hit", "EE3D.cm", "TAR3D.cm", "DISP.cm",
                           "CTRL.cm", "CTRL.first_cm", "CTRL.deg", "CTRL.gripper", "loss"})
    EXPECT_TRUE(all->metrics.contains(name)) << name;
  for (const char* module : {"LANG", "EE2D", "TAR2D", "EE3D", "TAR3D", "DISP", "CTRL"})
    EXPECT_TRUE(all->errors.contains(module)) << module;
  EXPECT_NEAR(all->metrics.at("TAR3D.cm"), 100 * all->errors.at("TAR3D"), 1e-9);
  EXPECT_EQ(all->metrics, again->metrics);
  EXPECT_FALSE(early->errors.contains("CTRL"));
  EXPECT_TRUE((*policy)->is_training());
  EXPECT_EQ(Evaluate(**policy, maker, *snapshot, {}, 5, 8).error().code, Code::kNotFound);
}

TEST(EvaluateLanguage, AsksAboutSentencesOutsideOfTraining) {
  const TrainConfig config = TinyConfig();
  auto policy = policy::Policy::Create(config.policy, policy::Normalization::Unit(7), 1);
  ASSERT_TRUE(policy) << policy.error().message;
  (*policy)->train();
  const auto grammar = language::Grammar::Load();
  ASSERT_TRUE(grammar);

  const auto metrics = EvaluateLanguage(**policy, *grammar, {"pick", "push+others", "place_left"});

  ASSERT_EQ(metrics.size(), 3u);
  for (const auto& [name, accuracy] : metrics) {
    EXPECT_GE(accuracy, 0) << name;
    EXPECT_LE(accuracy, 0.6) << name << " of an untrained policy";
  }
  EXPECT_EQ(EvaluateLanguage(**policy, *grammar, {"pick", "push+others", "place_left"}), metrics);
  EXPECT_TRUE((*policy)->is_training());
}

// before, the first validation of such a graph ended the program
TEST(EvaluateLanguage, TakesAGraphWhoseFirstLevelLooksAndWhoseLanguageModuleReadsNoSentence) {
  TrainConfig config = TinyConfig();
  for (auto& module : config.policy.modules) {
    if (module.name == "EE2D") module.level = 1;
    if (module.name != "LANG") continue;
    module.reads = {"joints"};
    module.attend.clear();
  }
  auto policy = policy::Policy::Create(config.policy, policy::Normalization::Unit(7), 1);
  ASSERT_TRUE(policy) << policy.error().message;
  const auto grammar = language::Grammar::Load();
  ASSERT_TRUE(grammar);

  const auto metrics = EvaluateLanguage(**policy, *grammar, {"pick"});

  ASSERT_EQ(metrics.size(), 3u);
  for (const auto& [name, accuracy] : metrics) {
    EXPECT_GE(accuracy, 0) << name;
    EXPECT_LE(accuracy, 1) << name;
  }
}

}  // namespace evaluate_test
}  // namespace etude::learn
