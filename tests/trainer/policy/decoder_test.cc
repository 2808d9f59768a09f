// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/decoder.cc
#include "trainer/policy/decoder.h"

#include <gtest/gtest.h>

namespace etude::policy {
namespace decoder_test {

constexpr char kPrefix[] = "modules.TAR3D.decoder.";

std::map<std::string, torch::Tensor> TensorsOf(const Decoder& decoder) {
  std::map<std::string, torch::Tensor> tensors;
  for (const auto& item : decoder.named_parameters()) tensors[kPrefix + item.key()] = item.value();
  return tensors;
}

/// Whether what it reads comes through where its first layer makes nothing of it.
bool ComesThrough(Decoder& decoder) {
  const torch::NoGradGuard no_grad;
  for (const auto& item : decoder.named_parameters())
    if (item.key().starts_with("from.")) item.value().zero_();
  const auto of = [&](double value) {
    return decoder.Forward({torch::full({1, 1, 3}, value), torch::full({1, 1, 2}, value)});
  };
  return !torch::equal(of(0), of(1));
}

// Surgery asks the tensors of a file what a network does that it does not build.
TEST(Decoder, ItsTensorsTellWhetherItAddsItsInputs) {
  torch::manual_seed(1);
  const std::vector<std::pair<std::string, int>> inputs{{"joints", 3}, {"TAR2D", 2}};
  for (const auto& [hidden, adds] : std::vector<std::pair<std::vector<int>, bool>>{
           {{5, 5}, true}, {{5}, true}, {{4, 5}, false}, {{6, 6}, false}, {{}, false}}) {
    const int outputs = 5;  // as wide as what is read: an answer is never added to
    Decoder decoder(inputs, hidden, outputs, "relu");
    EXPECT_EQ(Decoder::AddsItsInputs(TensorsOf(decoder), kPrefix), adds) << hidden.size();
    EXPECT_EQ(ComesThrough(decoder), adds) << hidden.size();
  }
  EXPECT_FALSE(Decoder::AddsItsInputs({}, kPrefix));
}

}  // namespace decoder_test
}  // namespace etude::policy
