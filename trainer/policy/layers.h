// SPDX-License-Identifier: Apache-2.0
// Small building blocks: a multi-layer perceptron, a token head, a normalisation followed by ReLU.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "trainer/policy/torch.h"

namespace etude::policy {

/// silu, selu or relu.
torch::Tensor Activate(const torch::Tensor& x, const std::string& activation);

/// Layer normalisation over the last axis without parameters of its own type: always in float32.
class LayerNorm : public torch::nn::Module {
 public:
  explicit LayerNorm(int width);
  torch::Tensor Forward(const torch::Tensor& x);

 private:
  torch::Tensor weight_, bias_;
};

/// Linear layers with an activation between them; a hidden layer as wide as the one before is
/// residual.
class Mlp : public torch::nn::Module {
 public:
  enum class Output { kLinear, kActivated };
  Mlp(int inputs, const std::vector<int>& hidden, int outputs, std::string activation, Output output = Output::kLinear);
  torch::Tensor Forward(torch::Tensor x);

 private:
  std::vector<torch::nn::Linear> layers_;
  std::string activation_;
  Output output_;
};

/// Linear + LayerNorm + activation: the paper's maps from tokens and slots to queries, keys and values. The linear map
/// is computed in the type of what it reads, the rest and the result in float32.
class TokenHead : public torch::nn::Module {
 public:
  TokenHead(int inputs, int outputs, std::string activation);
  torch::Tensor Forward(const torch::Tensor& x);

 private:
  torch::nn::Linear linear_{nullptr};
  std::shared_ptr<LayerNorm> norm_;
  std::string activation_;
};

/// Share of a batch in the running statistics of batch normalisation.
inline constexpr double kNormMomentum = 0.1;

/// relu(norm(x) [+ residual]) over (B, C, H, W); statistics in float32 whatever the type of x.
class NormRelu : public torch::nn::Module {
 public:
  enum class Kind { kBatch, kInstance, kNone };
  NormRelu(int channels, Kind kind);
  torch::Tensor Forward(const torch::Tensor& x, const torch::Tensor& residual = {});

 private:
  Kind kind_;
  torch::Tensor weight_, bias_;               ///< (C), batch only (the original's instance norm has none)
  torch::Tensor running_mean_, running_var_;  ///< (C), batch only
};

}  // namespace etude::policy
