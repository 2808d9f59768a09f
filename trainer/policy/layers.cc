// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/layers.h"

#include <fmt/format.h>
#include <torch/csrc/jit/frontend/tracer.h>

#include "services/core/check.h"
#include "trainer/policy/fused_norm.h"

namespace etude::policy {

torch::Tensor Activate(const torch::Tensor& x, const std::string& activation) {
  if (activation == "silu") return torch::silu(x);
  if (activation == "selu") return torch::selu(x);
  ETUDE_CHECK(activation == "relu", "{}", activation);
  return torch::relu(x);
}

LayerNorm::LayerNorm(int width)
    : weight_(register_parameter("weight", torch::ones({width}))),
      bias_(register_parameter("bias", torch::zeros({width}))) {}

torch::Tensor LayerNorm::Forward(const torch::Tensor& x) {
  return torch::layer_norm(x.to(weight_.scalar_type()), weight_.sizes(), weight_, bias_);
}

Mlp::Mlp(int inputs, const std::vector<int>& hidden, int outputs, std::string activation, Output output)
    : activation_(std::move(activation)), output_(output) {
  int width = inputs;
  for (std::size_t i = 0; i <= hidden.size(); ++i) {
    const int next = i < hidden.size() ? hidden[i] : outputs;
    layers_.push_back(register_module(fmt::format("layer{}", i), torch::nn::Linear(width, next)));
    width = next;
  }
}

torch::Tensor Mlp::Forward(torch::Tensor x) {
  for (std::size_t i = 0; i < layers_.size(); ++i) {
    torch::Tensor y = layers_[i]->forward(x);
    const bool last = i + 1 == layers_.size();
    if (!last || output_ == Output::kActivated) y = Activate(y, activation_);
    x = !last && y.size(-1) == x.size(-1) ? x + y : y;
  }
  return x;
}

TokenHead::TokenHead(int inputs, int outputs, std::string activation)
    : linear_(register_module("linear", torch::nn::Linear(inputs, outputs))),
      norm_(register_module("norm", std::make_shared<LayerNorm>(outputs))),
      activation_(std::move(activation)) {}

torch::Tensor TokenHead::Forward(const torch::Tensor& x) {
  const auto type = x.scalar_type();
  const torch::Tensor mapped = torch::linear(x, linear_->weight.to(type), linear_->bias.to(type));
  return Activate(norm_->Forward(mapped), activation_);
}

NormRelu::NormRelu(int channels, Kind kind) : kind_(kind) {
  if (kind_ != Kind::kBatch) return;
  weight_ = register_parameter("weight", torch::ones({channels}));
  bias_ = register_parameter("bias", torch::zeros({channels}));
  running_mean_ = register_buffer("running_mean", torch::zeros({channels}));
  running_var_ = register_buffer("running_var", torch::ones({channels}));
}

torch::Tensor NormRelu::Forward(const torch::Tensor& x, const torch::Tensor& residual) {
  constexpr double kEpsilon = 1e-5;
  // what is traced must run where this program is not: in torch's own operations
  if (kind_ != Kind::kNone && CanFuseNormRelu(x) && !torch::jit::tracer::isTracing()) {
    const FusedNorm norm{.per_image = kind_ == Kind::kInstance,
                         .training = kind_ == Kind::kInstance || is_training(),
                         .epsilon = kEpsilon,
                         .momentum = kNormMomentum};
    return FusedNormRelu(norm, x, weight_, bias_, running_mean_, running_var_, residual);
  }
  // as the kernel does it: float32 inside, rounded once
  const bool rounds = kind_ != Kind::kNone && x.scalar_type() == torch::kBFloat16;
  const torch::Tensor wide = rounds ? x.to(torch::kFloat32) : x;
  torch::Tensor y = wide;
  if (kind_ == Kind::kBatch)
    y = torch::batch_norm(wide, weight_, bias_, running_mean_, running_var_, is_training(), kNormMomentum, kEpsilon,
                          /*cudnn_enabled=*/true);
  if (kind_ == Kind::kInstance)
    y = torch::instance_norm(wide, {}, {}, {}, {}, /*use_input_stats=*/true, kNormMomentum, kEpsilon,
                             /*cudnn_enabled=*/true);
  if (residual.defined()) y = y + residual;
  return torch::relu(y).to(x.scalar_type()).contiguous(x.suggest_memory_format());
}

}  // namespace etude::policy
