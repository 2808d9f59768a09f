// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/device.cc: names of devices, and that torch's operations compute what our own kernels do.
#include "trainer/policy/device.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>

#include "tests/support/matchers.h"
#include "tests/trainer/policy/fixtures.h"
#include "trainer/policy/fused_norm.h"
#include "trainer/policy/layers.h"

namespace etude::policy {
namespace device_test {

TEST(Device, OfAWrongNameIsRefused) {
  for (const char* name : {"", "gpu", "cudaa", "cuda:", "cuda:x", "cuda:-1", "cuda:1x", "cpu:0"})
    EXPECT_THAT(OpenDevice(name), HasCode(Code::kInvalidArgument)) << name;
}

TEST(Device, TheCpuIsAlwaysThere) {
  const auto device = OpenDevice("cpu");
  ASSERT_THAT(device, IsOk());
  EXPECT_TRUE(device->is_cpu());
  const torch::Tensor here = torch::ones({2});
  EXPECT_TRUE(ToDevice(here, *device).is_same(here)) << "nothing to copy";
}

TEST(Device, SaysWhyThereIsNoCuda) {
  if (torch::cuda::is_available()) GTEST_SKIP() << "this machine has CUDA";
  for (const char* name : {"cuda", "cuda:0"}) {
    const auto device = OpenDevice(name);
    ASSERT_THAT(device, HasCode(Code::kUnavailable)) << name;
    EXPECT_THAT(device, MessageHas("CUDA"));
  }
}

TEST(Device, OneThatIsNotThereIsAnError) { EXPECT_THAT(OpenDevice("cuda:99"), HasCode(Code::kUnavailable)); }

/// The loss of a policy, and all gradients by name.
struct Learned {
  double loss = 0;
  std::map<std::string, torch::Tensor> gradients;
};

Learned Learn(const std::string& attention, const torch::Device& device) {
  PolicyConfig config = TinyConfig();
  config.attention = attention;
  const auto policy = MakePolicy(config);
  policy->to(device);
  policy->train();
  const Inputs inputs = MakeInputs(config, 3, 2);
  Labels labels = MakeLabels(config, 3, 2);
  for (auto& [name, label] : labels) label = ToDevice(label, device);
  const LossTerms loss = policy->Loss(inputs, policy->Forward(inputs), labels);
  loss.total.backward();
  Learned learned{loss.total.item<double>(), {}};
  for (const auto& item : policy->named_parameters())
    if (item.value().grad().defined()) learned.gradients[item.key()] = item.value().grad().to(torch::kCPU);
  return learned;
}

void ExpectSame(const Learned& ours, const Learned& theirs) {
  EXPECT_NEAR(ours.loss, theirs.loss, 1e-5 * std::abs(theirs.loss));
  ASSERT_EQ(ours.gradients.size(), theirs.gradients.size());
  double squares = 0, difference = 0;
  for (const auto& [name, gradient] : theirs.gradients) {
    squares += gradient.square().sum().item<double>();
    difference += (ours.gradients.at(name) - gradient).square().sum().item<double>();
  }
  EXPECT_GT(squares, 0);
  EXPECT_LE(std::sqrt(difference), 1e-5 * std::sqrt(squares));
}

class Kernels : public testing::TestWithParam<const char*> {};

TEST_P(Kernels, TorchsOperationsComputeWhatOursDo) {
  const torch::Tensor fits = torch::zeros({1, 16, 2, 2}).contiguous(torch::MemoryFormat::ChannelsLast);
  ASSERT_TRUE(CanFuseNormRelu(fits));
  const Learned ours = Learn(GetParam(), torch::kCPU);
  const AtenOnly forced;
  ASSERT_FALSE(CanFuseNormRelu(fits)) << "the fallback is not forced";
  ExpectSame(ours, Learn(GetParam(), torch::kCPU));
}

// float32 sums in another order: more differs than between two ways on one device
TEST_P(Kernels, CudaLearnsWhatTheCpuDoes) {
  if (!torch::cuda::is_available()) GTEST_SKIP() << "no CUDA device";
  const auto device = OpenDevice("cuda");
  ASSERT_THAT(device, IsOk());
  const Learned there = Learn(GetParam(), *device), here = Learn(GetParam(), torch::kCPU);
  EXPECT_NEAR(there.loss, here.loss, 1e-4 * std::abs(here.loss));
  for (const auto& [name, gradient] : here.gradients)
    EXPECT_TRUE(torch::allclose(there.gradients.at(name), gradient, 1e-2, 1e-4)) << name;
}

INSTANTIATE_TEST_SUITE_P(Attention, Kernels, testing::Values("module", "shared"));

TEST(NormRelu, TheFallbackComputesBfloat16InsideInFloat32) {
  torch::manual_seed(5);
  NormRelu norm(32, NormRelu::Kind::kBatch);
  const torch::Tensor x = (torch::randn({2, 32, 6, 6}) * 2 + 3).to(torch::kBFloat16).contiguous(kChannelsLast);
  const torch::Tensor ours = norm.Forward(x);
  const AtenOnly forced;
  const torch::Tensor theirs = norm.Forward(x);
  EXPECT_EQ(theirs.scalar_type(), torch::kBFloat16);
  EXPECT_TRUE(theirs.is_contiguous(kChannelsLast));
  // both round once: a last digit of bfloat16 is 2^-8 of the value
  EXPECT_TRUE(torch::allclose(ours.to(torch::kFloat32), theirs.to(torch::kFloat32), 1.0 / 128, 1e-6));
}

}  // namespace device_test
}  // namespace etude::policy
