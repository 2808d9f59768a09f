// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/flat.cc: our own kernels and torch's operations make the same steps.
#include "trainer/learn/flat.h"

#include <gtest/gtest.h>

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tests/trainer/learn/tiny_run.h"
#include "trainer/learn/optimizer.h"
#include "trainer/policy/device.h"
#include "trainer/policy/parts.h"

namespace etude::learn {
namespace flat_test {

using torch::Tensor;

// offsets are multiples of 16, and there is padding behind the second
const std::vector<FlatRange> kRanges{{0, 16}, {16, 21}, {48, 40}};
constexpr std::int64_t kSize = 96;

void ExpectClose(const Tensor& a, const Tensor& b) {
  EXPECT_TRUE(torch::allclose(a, b, 1e-5, 1e-7)) << (a - b).abs().max();
}

TEST(Flat, AddsAveragesAndSwapsAlike) {
  torch::manual_seed(1);
  const Tensor a = torch::randn({kSize}), b = torch::randn({kSize});
  const auto results = [&] {
    Tensor sum = a.clone(), average = a.clone(), first = a.clone(), second = b.clone();
    AddFlat(b, sum);
    AverageFlat(0.9, b, average);
    SwapFlat(first, second);
    return std::vector<Tensor>{sum, average, first, second};
  };
  const auto ours = results();
  const policy::AtenOnly forced;
  const auto theirs = results();
  for (std::size_t i = 0; i < ours.size(); ++i) ExpectClose(ours[i], theirs[i]);
  EXPECT_TRUE(torch::equal(theirs[2], b) && torch::equal(theirs[3], a));
}

TEST(Flat, SquaresAreOfEachRangeWithoutItsPadding) {
  Tensor flat = torch::full({kSize}, 2.0F);
  flat.narrow(0, 37, 11).fill_(100);  // padding
  for (const bool aten : {false, true}) {
    std::optional<policy::AtenOnly> forced;
    if (aten) forced.emplace();
    const auto squares = SquaresOf(flat, kRanges);
    ASSERT_EQ(squares.size(), 3u);
    EXPECT_NEAR(squares[0], 64, 1e-4);
    EXPECT_NEAR(squares[1], 84, 1e-4);
    EXPECT_NEAR(squares[2], 160, 1e-4);
    EXPECT_TRUE(SquaresOf(flat, {}).empty());
  }
}

TEST(Flat, StepsAlikeAndLeavesARangeWithoutAStepAlone) {
  torch::manual_seed(2);
  const Tensor gradient = torch::randn({kSize}), start = torch::randn({kSize});
  AdamwStep step{.lr = 1e-2F, .beta1 = 0.9F, .beta2 = 0.98F, .epsilon = 1e-8F, .decay = 0.01F};
  step.correction1 = 0.1F;
  step.correction2 = 0.02F;
  step.scale = 0.5F;
  const auto results = [&] {
    Tensor first = torch::full({kSize}, 0.1F), second = torch::full({kSize}, 0.2F), parameters = start.clone();
    UpdateFlat(kRanges, {step, std::nullopt, step}, {gradient, first, second, parameters});
    return std::vector<Tensor>{first, second, parameters};
  };
  const auto ours = results();
  const policy::AtenOnly forced;
  const auto theirs = results();
  for (std::size_t i = 0; i < ours.size(); ++i)
    for (const FlatRange& range : kRanges) {
      const auto at = static_cast<std::int64_t>(range.offset), count = static_cast<std::int64_t>(range.count);
      ExpectClose(ours[i].narrow(0, at, count), theirs[i].narrow(0, at, count));
    }
  EXPECT_TRUE(torch::equal(theirs[2].narrow(0, 16, 21), start.narrow(0, 16, 21)));
  EXPECT_FALSE(torch::equal(theirs[2].narrow(0, 48, 40), start.narrow(0, 48, 40)));
}

// Parameters and averages after steps with drawn gradients of which the largest are clipped.
std::map<std::string, Tensor> Stepped(const TrainConfig& config) {
  auto made = policy::Policy::Create(config.policy, policy::Normalization::Unit(7), 1);
  EXPECT_TRUE(made) << made.error().message;
  Optimizer optimizer(config.optimizer, {*made});
  torch::manual_seed(3);
  for (int step = 0; step < 5; ++step) {
    optimizer.ZeroGradients();
    for (const auto& item : (*made)->named_parameters())
      if (policy::PartOfTensor(item.key()) != "CTRL")  // not trained yet
        Tensor(item.value().grad()).copy_(torch::randn(item.value().sizes()));
    optimizer.Step(1e-2);
    optimizer.UpdateAverage(0.9);
  }
  optimizer.ExchangeAverage();
  std::map<std::string, Tensor> tensors;
  for (const auto& item : (*made)->named_parameters()) tensors[item.key()] = item.value().detach().clone();
  for (const auto& [name, tensor] : optimizer.StateTensors()) tensors["state/" + name] = tensor.clone();
  return tensors;
}

TEST(Flat, TheOptimizerMakesTheSameStepsWithTorchsOperations) {
  const TrainConfig config = TinyConfig();
  const auto ours = Stepped(config);
  const policy::AtenOnly forced;
  const auto theirs = Stepped(config);
  ASSERT_EQ(ours.size(), theirs.size());
  for (const auto& [name, tensor] : ours) EXPECT_TRUE(torch::allclose(tensor, theirs.at(name), 1e-5, 1e-6)) << name;
}

}  // namespace flat_test
}  // namespace etude::learn
