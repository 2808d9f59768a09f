// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/evaluate.cc
#include "trainer/learn/evaluate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <vector>

#include "tests/trainer/learn/tiny_run.h"
#include "trainer/data/statistics.h"
#include "trainer/learn/tensors.h"

namespace etude::learn {
namespace evaluate_test {

// validation frames of synthetic episodes
class EvaluateTest : public ::testing::Test {
 protected:
  void Prepare(const TrainConfig& config) {
    config_ = config;
    dataset_ = TinyDataset(folder_ / "d", 24);
    ASSERT_TRUE(dataset_->Refresh());
    snapshot_ = dataset_->snapshot();
    auto grammar = language::Grammar::Load();
    ASSERT_TRUE(grammar);
    maker_ = std::make_unique<data::BatchMaker>(config.data, TinyContent(config.policy, dataset_->spec()),
                                                std::make_shared<const language::Grammar>(std::move(*grammar)));
    samples_ = data::SpreadFrames(*snapshot_, data::Split::kValid, 1, 20);
  }
  std::shared_ptr<policy::Policy> Untrained(std::uint64_t seed) const {
    const auto statistics = data::ComputeStatistics(*snapshot_);
    EXPECT_TRUE(statistics);
    auto policy = policy::Policy::Create(config_.policy, ToNormalization(*statistics), seed);
    EXPECT_TRUE(policy) << policy.error().message;
    (*policy)->train();
    return *policy;
  }
  Result<Evaluation> Measure(policy::Policy& policy, int level, const std::vector<data::Sample>& samples) const {
    return Evaluate(policy, {*maker_, *snapshot_, samples, level, 8});
  }

  TemporaryFolder folder_;
  TrainConfig config_;
  std::shared_ptr<data::Dataset> dataset_;
  std::shared_ptr<const data::Snapshot> snapshot_;
  std::unique_ptr<data::BatchMaker> maker_;
  std::vector<data::Sample> samples_;
};

TEST_F(EvaluateTest, MeasuresEveryModuleInUnitsOfPeopleAndLeavesThePolicyTraining) {
  ASSERT_NO_FATAL_FAILURE(Prepare(TinyConfig()));
  const auto policy = Untrained(1);

  const auto all = Measure(*policy, 5, samples_);
  const auto again = Measure(*policy, 5, samples_);
  const auto early = Measure(*policy, 2, samples_);

  ASSERT_TRUE(all) << all.error().message;
  for (const char* name : {"LANG.accuracy", "EE2D.px", "TAR2D.px", "TAR2D.hit", "EE3D.cm", "TAR3D.cm", "DISP.cm",
                           "CTRL.cm", "CTRL.first_cm", "CTRL.deg", "CTRL.gripper", "loss"})
    EXPECT_TRUE(all->metrics.contains(name)) << name;
  for (const char* module : {"LANG", "EE2D", "TAR2D", "EE3D", "TAR3D", "DISP", "CTRL"})
    EXPECT_TRUE(all->errors.contains(module)) << module;
  EXPECT_NEAR(all->metrics.at("TAR3D.cm"), 100 * all->errors.at("TAR3D"), 1e-9);
  EXPECT_EQ(all->metrics, again->metrics);
  EXPECT_FALSE(early->errors.contains("CTRL"));
  EXPECT_TRUE(policy->is_training());
  EXPECT_EQ(Measure(*policy, 5, {}).error().code, Code::kNotFound);
}

// Sentences whose module OTHERS2D looks at a patch of 8 px with one of the others in it, and all that have one in view.
struct Hits {
  int hits = 0, all = 0;
};

Hits CountByHand(const Part& part, const policy::ModuleOutput& looks, int side) {
  const auto pixel = part.labels.at("others.pixel"), valid = part.labels.at("others.pixel.valid");
  Hits count;
  for (std::int64_t b = 0; b < pixel.size(0); ++b)
    for (std::int64_t s = 0; s < pixel.size(1); ++s) {
      const auto row = looks.attention[b][looks.attention.size(1) == 1 ? 0 : s].narrow(0, 0, side * side);
      const auto best = row.argmax().item<std::int64_t>();
      bool hit = false, any = false;
      for (std::int64_t k = 0; k < pixel.size(2); ++k) {
        if (!valid[b][s][k].item<bool>()) continue;
        const auto at = (pixel[b][s][k] - part.inputs.crop_origin[b]) / 8;
        const auto u = static_cast<std::int64_t>(std::floor(at[0].item<float>()));
        const auto v = static_cast<std::int64_t>(std::floor(at[1].item<float>()));
        if (u < 0 || v < 0 || u >= side || v >= side) continue;
        any = true;
        hit = hit || best == v * side + u;
      }
      count.all += any;
      count.hits += hit;
    }
  return count;
}

// the other ranks of a long validation took this one for lost
TEST_F(EvaluateTest, SaysThatItIsThereBeforeEachBatch) {
  ASSERT_NO_FATAL_FAILURE(Prepare(TinyConfig()));
  const auto policy = Untrained(1);
  std::size_t said = 0;
  ASSERT_TRUE(Evaluate(*policy, {*maker_, *snapshot_, samples_, 5, 8, [&] { ++said; }}));
  EXPECT_EQ(said, (samples_.size() + 7) / 8);
}

TEST_F(EvaluateTest, LeavesOutPicturesThatCannotBeReadAndEndsWhereNoneCan) {
  TrainConfig config = TinyConfig({"data.cache_mb=0"});
  ASSERT_NO_FATAL_FAILURE(Prepare(config));
  const auto policy = Untrained(1);
  samples_ = data::SpreadFrames(*snapshot_, data::Split::kTrain, 1, 20);  // of several episodes
  const std::size_t gone = samples_.front().frame.episode;
  std::vector<data::Sample> left;
  for (const auto& sample : samples_)
    if (sample.frame.episode != gone) left.push_back(sample);
  ASSERT_FALSE(left.empty());
  const auto expected = Measure(*policy, 5, left);
  ASSERT_TRUE(expected);

  std::filesystem::remove(snapshot_->episodes()[gone]->record.path);
  const auto measured = Measure(*policy, 5, samples_);
  ASSERT_TRUE(measured) << measured.error().message;
  for (const char* name : {"TAR3D.cm", "loss"})
    EXPECT_NEAR(measured->metrics.at(name), expected->metrics.at(name), 1e-4 * expected->metrics.at(name)) << name;

  for (const auto& entry : snapshot_->episodes()) std::filesystem::remove(entry->record.path);
  const auto none = Measure(*policy, 5, samples_);
  ASSERT_FALSE(none);
  EXPECT_NE(none.error().message.find("none of"), std::string::npos) << none.error().message;
  EXPECT_TRUE(policy->is_training());
}

// before, such a module had no error: only the budget ended its level
TEST_F(EvaluateTest, OfASetAnyMembersPatchIsAHit) {
  TrainConfig config = TinyConfig({"policy.image.crop=[4, 4, 40, 40]",
                                   "policy.image.layers=[{kind: conv, channels: 16, kernel: 5, stride: 2}, {kind: "
                                   "conv, channels: 16, kernel: 3, stride: 2}, {kind: conv, channels: 16, kernel: 3, "
                                   "stride: 2}]"});
  policy::ModuleConfig module;
  module.name = "OTHERS2D";
  module.level = 2;
  module.query = "LANG";
  module.reads = {"image", "language"};
  module.attend = {"image@others"};
  config.policy.modules.push_back(module);
  ASSERT_NO_FATAL_FAILURE(Prepare(config));

  Hits all;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const auto policy = Untrained(seed);
    Hits own;
    const auto count = [&](const std::vector<data::Sample>&, const Part& part, const policy::Outputs& outputs) {
      const Hits more = CountByHand(part, outputs.at("OTHERS2D"), 5);
      own.hits += more.hits;
      own.all += more.all;
    };
    ASSERT_TRUE(VisitBatches(*policy, {*maker_, *snapshot_, samples_, 2, 8}, count));
    ASSERT_GT(own.all, 0);
    const auto measured = Measure(*policy, 2, samples_);
    ASSERT_TRUE(measured) << measured.error().message;
    ASSERT_TRUE(measured->errors.contains("OTHERS2D"));
    EXPECT_NEAR(measured->errors.at("OTHERS2D"), 1 - own.hits / static_cast<double>(own.all), 1e-9) << seed;
    all.hits += own.hits;
    all.all += own.all;
  }
  EXPECT_GT(all.hits, 0);
  EXPECT_LT(all.hits, all.all);
}

TEST(EvaluateLanguage, AsksAboutSentencesOutsideOfTraining) {
  const TrainConfig config = TinyConfig();
  auto policy = policy::Policy::Create(config.policy, policy::Normalization::Unit(7), 1);
  ASSERT_TRUE(policy) << policy.error().message;
  (*policy)->train();
  const auto grammar = language::Grammar::Load();
  ASSERT_TRUE(grammar);

  const auto metrics =
      EvaluateLanguage(**policy, *grammar, {"pick", "push+others", "place_left"}, config.policy.objects);

  ASSERT_EQ(metrics.size(), 8u);
  for (const char* what : {"unseen", "phrases", "noisy", "clauses"}) {
    ASSERT_TRUE(metrics.contains(std::string("LANG.") + what)) << what;
    EXPECT_LE(metrics.at(std::string("LANG.") + what), 0.6) << what << " of an untrained policy";
    EXPECT_TRUE(metrics.contains(std::string("TASK.") + what)) << what;
  }
  for (const auto& [name, accuracy] : metrics) EXPECT_GE(accuracy, 0) << name;
  EXPECT_EQ(EvaluateLanguage(**policy, *grammar, {"pick", "push+others", "place_left"}, config.policy.objects),
            metrics);
  EXPECT_TRUE((*policy)->is_training());
}

// A task head that has learned to say one thing is right where that is meant, of the tasks that the policy knows.
TEST(EvaluateLanguage, AsksWhatToDoToo) {
  TrainConfig config = TinyConfig();
  config.policy.tasks = {"pick", "push"};
  auto policy = policy::Policy::Create(config.policy, policy::Normalization::Unit(7), 1);
  ASSERT_TRUE(policy) << policy.error().message;
  const auto grammar = language::Grammar::Load();
  ASSERT_TRUE(grammar);
  const torch::NoGradGuard no_grad;
  for (const auto& [name, tensor] : (*policy)->StateTensors())
    if (name.starts_with("modules.TASK.decoder")) torch::Tensor(tensor).zero_();  // all alike: the first one, "pick"

  const auto metrics = EvaluateLanguage(**policy, *grammar, {"pick", "push", "rotate"}, config.policy.objects);

  EXPECT_EQ(metrics.at("TASK.phrases"), 0) << "all of them push";
  EXPECT_EQ(metrics.at("TASK.noisy"), 0.5);
  EXPECT_EQ(metrics.at("TASK.clauses"), 0.5);
  EXPECT_GT(metrics.at("TASK.unseen"), 0.5) << "of those that pick or push, most pick";
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

  const auto metrics = EvaluateLanguage(**policy, *grammar, {"pick"}, config.policy.objects);

  ASSERT_EQ(metrics.size(), 7u) << "nothing is pushed";
  for (const auto& [name, accuracy] : metrics) {
    EXPECT_GE(accuracy, 0) << name;
    EXPECT_LE(accuracy, 1) << name;
  }
}

}  // namespace evaluate_test
}  // namespace etude::learn
