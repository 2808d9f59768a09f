// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/fused_norm.cc and its kernels against torch's own operations.
#include "trainer/policy/fused_norm.h"

#include <gtest/gtest.h>

#include "trainer/policy/norm_kernel.h"

namespace etude::policy {
namespace fused_norm_test {

using torch::Tensor;

struct Case {
  bool per_image, training, residual;
  int channels;
};

Tensor Random(std::vector<std::int64_t> sizes) {
  return torch::randn(sizes).contiguous(torch::MemoryFormat::ChannelsLast);
}

/// Outputs, then gradients of x, weight, bias, residual, then running statistics.
std::vector<Tensor> Evaluate(const Case& c, bool fused, torch::ScalarType type) {
  torch::manual_seed(9);
  Tensor x = (Random({3, c.channels, 5, 7}) * 2 + 3).to(type).detach().requires_grad_(true);
  Tensor residual = Random({3, c.channels, 5, 7}).to(type).detach().requires_grad_(true);
  const Tensor upstream = Random({3, c.channels, 5, 7});
  Tensor weight = torch::rand({c.channels}).add(0.5).requires_grad_(true);
  Tensor bias = torch::randn({c.channels}).requires_grad_(true);
  Tensor mean = torch::full({c.channels}, 2.5F), var = torch::full({c.channels}, 3.0F);
  if (c.per_image) weight = bias = mean = var = Tensor();
  Tensor y;
  if (fused) {
    EXPECT_TRUE(CanFuseNormRelu(x));
    const FusedNorm norm{.per_image = c.per_image, .training = c.training};
    y = FusedNormRelu(norm, x, weight, bias, mean, var, c.residual ? residual : Tensor());
  } else {
    const Tensor wide = x.to(torch::kFloat32).contiguous();
    y = c.per_image ? torch::instance_norm(wide, {}, {}, {}, {}, true, 0.1, 1e-5, false)
                    : torch::batch_norm(wide, weight, bias, mean, var, c.training, 0.1, 1e-5, false);
    if (c.residual) y = y + residual;
    y = torch::relu(y);
  }
  (y.to(torch::kFloat32) * upstream).sum().backward();
  std::vector<Tensor> results{y.detach().to(torch::kFloat32), x.grad().to(torch::kFloat32)};
  if (c.residual) results.push_back(residual.grad().to(torch::kFloat32));
  if (!c.per_image) results.insert(results.end(), {weight.grad(), bias.grad(), mean, var});
  return results;
}

class FusedNormTest : public testing::TestWithParam<Case> {};

TEST_P(FusedNormTest, EqualsTorchInFloat32) {
  const auto fused = Evaluate(GetParam(), true, torch::kFloat32);
  const auto plain = Evaluate(GetParam(), false, torch::kFloat32);
  ASSERT_EQ(fused.size(), plain.size());
  for (std::size_t i = 0; i < fused.size(); ++i)
    EXPECT_TRUE(torch::allclose(fused[i], plain[i], 1e-4, 2e-5)) << i << " " << (fused[i] - plain[i]).abs().max();
}

TEST_P(FusedNormTest, IsCloseInBfloat16) {
  const auto fused = Evaluate(GetParam(), true, torch::kBFloat16);
  const auto plain = Evaluate(GetParam(), false, torch::kBFloat16);
  for (std::size_t i = 0; i < fused.size(); ++i) {
    // rounding moves a value over the edge of ReLU now and then, so compare in the mean
    const double scale = plain[i].abs().mean().item<double>();
    EXPECT_LT((fused[i] - plain[i]).abs().mean().item<double>(), 0.01 * scale) << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, FusedNormTest,
                         testing::Values(Case{false, true, false, 16}, Case{false, true, true, 48},
                                         Case{false, false, true, 32}, Case{true, true, false, 64},
                                         Case{true, true, true, 112}));

TEST(FusedNorm, KeepsDigitsWhenTheMeanIsLarge) {
  torch::manual_seed(10);
  const Tensor noise = Random({4, 16, 32, 32});
  const FusedNorm norm{.per_image = true};
  const Tensor around_zero = FusedNormRelu(norm, noise, {}, {}, {}, {}, {});
  const Tensor far_away = FusedNormRelu(norm, noise + 1000, {}, {}, {}, {}, {});
  EXPECT_LT((around_zero - far_away).abs().max().item<float>(), 1e-3);
}

TEST(FusedNorm, LeavesOtherLayoutsToTorch) {
  EXPECT_FALSE(CanFuseNormRelu(torch::zeros({2, 16, 4, 4})));
  EXPECT_FALSE(CanFuseNormRelu(Random({2, 20, 4, 4})));
  EXPECT_FALSE(CanFuseNormRelu(Random({2, 16, 4, 4}).to(torch::kFloat64)));
}

TEST(NormKernel, AnyCpuAndThisCpuAgree) {
  torch::manual_seed(11);
  constexpr int kRows = 33, kChannels = 112;
  const Tensor x = torch::randn({kRows, kChannels}), scale = torch::randn({kChannels}),
               offset = torch::randn({kChannels});
  const NormRows rows{.x = x.data_ptr(), .rows = kRows, .channels = kChannels};
  Tensor a = torch::empty_like(x), b = torch::empty_like(x);
  generic::Kernel(NormType::kFloat32).apply(rows, scale.data_ptr<float>(), offset.data_ptr<float>(), a.data_ptr());
  NormKernelFor(NormType::kFloat32).apply(rows, scale.data_ptr<float>(), offset.data_ptr<float>(), b.data_ptr());
  EXPECT_TRUE(torch::allclose(a, torch::relu(x * scale + offset), 1e-5, 1e-6));
  EXPECT_TRUE(torch::allclose(a, b, 1e-5, 1e-6));  // fused multiply-add differs in the last digit
}

}  // namespace fused_norm_test
}  // namespace etude::policy
