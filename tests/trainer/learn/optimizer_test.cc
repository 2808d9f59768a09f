// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/optimizer.cc and trainer/learn/replicas.cc
#include "trainer/learn/optimizer.h"

#include <gtest/gtest.h>
#include <torch/optim/adamw.h>

#include <cmath>

#include "tests/trainer/learn/tiny_run.h"
#include "trainer/learn/replicas.h"
#include "trainer/learn/tensors.h"
#include "trainer/policy/parts.h"

namespace etude::learn {
namespace optimizer_test {

std::vector<std::shared_ptr<policy::Policy>> Policies(const TrainConfig& config, int n) {
  std::vector<std::shared_ptr<policy::Policy>> policies;
  for (int i = 0; i < n; ++i) {
    auto policy = policy::Policy::Create(config.policy, policy::Normalization::Unit(7), 1);
    EXPECT_TRUE(policy) << policy.error().message;
    (*policy)->train();
    policies.push_back(*policy);
  }
  return policies;
}

data::Batch MakeBatch(const TrainConfig& config, const Path& folder) {
  auto dataset = TinyDataset(folder, 6);
  EXPECT_TRUE(dataset->Refresh());
  auto grammar = language::Grammar::Load();
  EXPECT_TRUE(grammar);
  const data::BatchMaker maker(config.data, TinyContent(config.policy, dataset->spec()),
                               std::make_shared<const language::Grammar>(std::move(*grammar)));
  const auto snapshot = dataset->snapshot();
  data::Batch batch;
  data::FrameScratch scratch;
  const Status made = maker.Make(*snapshot, data::DrawBatch(*snapshot, data::Split::kTrain, 1, 0, config.data.batch), 0,
                                 data::Augment::kYes, scratch, batch);
  EXPECT_TRUE(made) << made.error().message;
  return batch;
}

TEST(LearningRate, WarmsUpAndFallsAlongACosine) {
  OptimizerConfig config;
  config.lr = 1;
  config.warmup_steps = 10;
  EXPECT_DOUBLE_EQ(LearningRate(config, 0, 0), 0.1);
  EXPECT_DOUBLE_EQ(LearningRate(config, 9, 0), 1.0);
  EXPECT_NEAR(LearningRate(config, 100, 0.5), 0.505, 1e-12);
  EXPECT_NEAR(LearningRate(config, 100, 1), 0.01, 1e-12);
  config.schedule = "constant";
  EXPECT_DOUBLE_EQ(LearningRate(config, 100, 0.9), 1.0);
}

TEST(Optimizer, TakesTheSameStepAsTorchsAdamW) {
  const TemporaryFolder folder;
  TrainConfig config = TinyConfig();
  config.optimizer.clip = 0;
  data::Batch batch = MakeBatch(config, folder / "d");
  const int level = 5;

  auto ours = Policies(config, 1), theirs = Policies(config, 1);
  std::vector<torch::Tensor> matrices, vectors;
  for (auto& p : theirs[0]->parameters()) (p.dim() >= 2 ? matrices : vectors).push_back(p);
  const auto options = [&](double decay) {
    return std::make_unique<torch::optim::AdamWOptions>(
        torch::optim::AdamWOptions(1e-3).betas({0.9, 0.98}).weight_decay(decay));
  };
  torch::optim::AdamW reference({torch::optim::OptimizerParamGroup(matrices, options(config.optimizer.weight_decay)),
                                 torch::optim::OptimizerParamGroup(vectors, options(0))},
                                torch::optim::AdamWOptions(1e-3));
  Optimizer optimizer(config.optimizer, ours);
  Replicas replicas(ours);
  auto named = theirs[0]->named_parameters();
  for (int step = 0; step < 3; ++step) {
    optimizer.ZeroGradients();
    ASSERT_TRUE(replicas.Backward(batch, level));
    // the same gradient for both: after the first step, rounding alone would tell the two networks' own ones apart
    // (and none for what nothing reads, which both then leave alone)
    for (const auto& item : ours[0]->named_parameters()) {
      const torch::Tensor gradient = item.value().grad();
      if (gradient.any().item<bool>()) named[item.key()].mutable_grad() = gradient.clone();
    }
    optimizer.Step(1e-3);
    reference.step();
  }
  for (const auto& item : ours[0]->named_parameters()) {
    EXPECT_TRUE(torch::allclose(item.value(), named[item.key()], 1e-4, 2e-6)) << item.key();
  }
}

TEST(Optimizer, LeavesModulesAloneThatAreNotTrainedYet) {
  const TemporaryFolder folder;
  const TrainConfig config = TinyConfig();
  data::Batch batch = MakeBatch(config, folder / "d");
  auto policies = Policies(config, 1);
  std::map<std::string, torch::Tensor> before;
  for (const auto& item : policies[0]->named_parameters()) before[item.key()] = item.value().clone();
  Optimizer optimizer(config.optimizer, policies);
  Replicas replicas(policies);

  optimizer.ZeroGradients();
  ASSERT_TRUE(replicas.Backward(batch, 1));
  const auto outcome = optimizer.Step(1e-3);

  const auto control = policies[0]->ParametersOf("CTRL");
  ASSERT_FALSE(control.empty());
  auto named = policies[0]->named_parameters();
  for (const auto& name : control) EXPECT_TRUE(torch::equal(named[name], before[name])) << name;
  int moved = 0;
  for (const auto& name : policies[0]->ParametersOf("LANG")) moved += !torch::equal(named[name], before[name]);
  EXPECT_GT(moved, 0);
  EXPECT_TRUE(outcome.part_norms.contains("LANG"));
  EXPECT_FALSE(outcome.part_norms.contains("CTRL"));
}

TEST(Optimizer, TellsHowLargeEachPartsGradientIs) {
  const TemporaryFolder folder;
  const TrainConfig config = TinyConfig();
  data::Batch batch = MakeBatch(config, folder / "d");
  auto policies = Policies(config, 2);
  Optimizer optimizer(config.optimizer, policies);
  Replicas replicas(policies);
  optimizer.ZeroGradients();
  ASSERT_TRUE(replicas.Backward(batch, 5));
  const torch::Tensor mean = optimizer.SumGradients() / 2;
  std::map<std::string, double> expected;  // of the first replica, which has the sum now
  for (const auto& part : policy::PartsOf(config.policy))
    for (const auto& name : policies[0]->ParametersOf(part)) {
      const torch::Tensor gradient = policies[0]->named_parameters()[name].grad() / 2;
      expected[part] = std::hypot(expected[part], gradient.norm().item<double>());
    }

  const auto outcome = optimizer.Step(1e-3);

  EXPECT_NEAR(outcome.gradient_norm, mean.norm().item<double>(), 1e-4 * outcome.gradient_norm);
  double sum = 0;
  for (const auto& [part, norm] : outcome.part_norms) {
    EXPECT_NEAR(norm, expected[part], 1e-4 * outcome.gradient_norm) << part;
    sum += norm * norm;
  }
  EXPECT_NEAR(std::sqrt(sum), outcome.gradient_norm, 1e-9 * outcome.gradient_norm);
  EXPECT_GE(outcome.part_norms.size(), config.policy.modules.size());
}

TEST(Optimizer, NeverMovesFrozenParameters) {
  const TemporaryFolder folder;
  const TrainConfig config = TinyConfig();
  data::Batch batch = MakeBatch(config, folder / "d");
  auto policies = Policies(config, 1);
  const auto names = policies[0]->ParametersOf("TAR2D");
  ASSERT_FALSE(names.empty());
  std::map<std::string, torch::Tensor> before;
  for (const auto& item : policies[0]->named_parameters()) before[item.key()] = item.value().clone();
  policies[0]->Freeze({"TAR2D"});
  Optimizer optimizer(config.optimizer, policies);
  Replicas replicas(policies);

  optimizer.ZeroGradients();
  ASSERT_TRUE(replicas.Backward(batch, 5));
  optimizer.Step(1e-2);

  auto named = policies[0]->named_parameters();
  for (const auto& name : names) EXPECT_TRUE(torch::equal(named[name], before[name])) << name;
}

TEST(Replicas, AverageToTheGradientOfTheWholeBatchWithoutBatchNorm) {
  const TemporaryFolder folder;
  const TrainConfig config = TinyConfig(
      {"policy.image.layers=[{kind: conv, channels: 8, kernel: 5, stride: 4, norm: none}]", "optimizer.clip=0"});
  data::Batch batch = MakeBatch(config, folder / "d");
  // every sample counts as much in each half only when none is masked
  for (auto& [name, label] : batch.labels) std::fill(label.valid.begin(), label.valid.end(), std::uint8_t{1});

  const auto step = [&](int n) {
    auto policies = Policies(config, n);
    Optimizer optimizer(config.optimizer, policies);
    Replicas replicas(policies);
    optimizer.ZeroGradients();
    const auto loss = replicas.Backward(batch, 5);
    EXPECT_TRUE(loss);
    return std::pair(loss->total, optimizer.Step(1e-3).gradient_norm);
  };
  const auto one = step(1), two = step(2);

  EXPECT_NEAR(one.first, two.first, 1e-4 * std::abs(one.first));
  EXPECT_NEAR(one.second, two.second, 1e-3 * one.second);
}

TEST(Optimizer, SharesWeightsBetweenReplicas) {
  const TrainConfig config = TinyConfig();
  auto policies = Policies(config, 2);
  Optimizer optimizer(config.optimizer, policies);
  const torch::NoGradGuard no_grad;
  policies[0]->parameters()[0].add_(1);
  EXPECT_TRUE(torch::equal(policies[0]->parameters()[0], policies[1]->parameters()[0]));
}

TEST(Optimizer, KeepsAnAverageAsideAndSwapsItInAndOut) {
  const TrainConfig config = TinyConfig();
  auto policies = Policies(config, 1);
  Optimizer optimizer(config.optimizer, policies);
  auto parameter = policies[0]->parameters()[0];
  const auto start = parameter.detach().clone();
  optimizer.UpdateAverage(0.5);
  {
    const torch::NoGradGuard no_grad;
    parameter.add_(1);
  }
  optimizer.UpdateAverage(0.5);

  optimizer.ExchangeAverage();
  const auto averaged = parameter.detach().clone();
  optimizer.ExchangeAverage();

  EXPECT_TRUE(torch::allclose(parameter, start + 1));
  EXPECT_GT((averaged - start).min().item<float>(), 0.4f);
  EXPECT_LT((averaged - start).max().item<float>(), 1.0f);
}

// else it was validated, and drove, as mostly what it had begun at, for as long as the run had gone before it
TEST(Optimizer, TheAverageOfAModuleThatBeginsLaterIsShortWhenItBegins) {
  const TemporaryFolder folder;
  const TrainConfig config = TinyConfig();
  data::Batch batch = MakeBatch(config, folder / "d");
  auto policies = Policies(config, 1);
  Optimizer optimizer(config.optimizer, policies);
  Replicas replicas(policies);
  auto named = policies[0]->named_parameters();
  torch::Tensor late;
  for (const auto& name : policies[0]->ParametersOf("CTRL"))
    if (named[name].dim() == 2) late = named[name];
  ASSERT_TRUE(late.defined());
  const torch::Tensor start = late.detach().clone();
  const auto step = [&](int level) {
    optimizer.ZeroGradients();
    ASSERT_TRUE(replicas.Backward(batch, level));
    optimizer.Step(1e-3);
    optimizer.UpdateAverage(0.998);
  };
  for (int i = 0; i < 60; ++i) step(1);
  ASSERT_TRUE(torch::equal(late, start));
  step(5);

  const torch::Tensor raw = late.detach().clone();
  optimizer.ExchangeAverage();
  const double share = ((late.detach() - start).norm() / (raw - start).norm()).item<double>();
  EXPECT_NEAR(share, 9.0 / 11, 1e-3) << "(1 + t) / (10 + t) of the start is left, t = 1";
}

}  // namespace optimizer_test
}  // namespace etude::learn
