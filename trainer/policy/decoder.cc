// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/decoder.h"

#include <fmt/format.h>

#include "trainer/policy/layers.h"

namespace etude::policy {

using torch::Tensor;

namespace {

constexpr char kFrom[] = "from";

std::string KeyOfLayer(std::size_t i) { return fmt::format("layer{}", i); }

/// The residual rule. @param last  of the layers: it makes the answer
bool IsResidual(std::int64_t reads, std::int64_t makes, bool last) { return !last && reads == makes; }

}  // namespace

Decoder::Decoder(const std::vector<std::pair<std::string, int>>& inputs, const std::vector<int>& hidden, int outputs,
                 std::string activation)
    : activation_(std::move(activation)) {
  int columns = 0;
  for (const auto& [name, width] : inputs) columns += width;
  std::vector<int> widths = hidden;
  widths.push_back(outputs);

  const torch::nn::Linear first(columns, widths[0]);
  const auto from = register_module(kFrom, std::make_shared<torch::nn::Module>());
  int column = 0;
  for (const auto& [name, width] : inputs) {
    from_.push_back(from->register_parameter(name, first->weight.detach().narrow(1, column, width).clone()));
    column += width;
  }
  bias_ = register_parameter("bias", first->bias.detach().clone());
  for (std::size_t i = 1; i < widths.size(); ++i)
    layers_.push_back(register_module(KeyOfLayer(i), torch::nn::Linear(widths[i - 1], widths[i])));
}

Tensor Decoder::Forward(const std::vector<Tensor>& features) {
  const Tensor input = features.size() == 1 ? features[0] : torch::cat(features, -1);
  const Tensor weight = from_.size() == 1 ? from_[0] : torch::cat(from_, 1);
  Tensor x = torch::linear(input, weight, bias_);
  if (!layers_.empty()) x = Activate(x, activation_);
  if (IsResidual(input.size(-1), x.size(-1), layers_.empty())) x = input + x;
  for (std::size_t i = 0; i < layers_.size(); ++i) {
    Tensor y = layers_[i]->forward(x);
    const bool last = i + 1 == layers_.size();
    if (!last) y = Activate(y, activation_);
    x = IsResidual(x.size(-1), y.size(-1), last) ? x + y : y;
  }
  return x;
}

bool Decoder::AddsItsInputs(const std::map<std::string, Tensor>& tensors, const std::string& prefix) {
  const std::string from = fmt::format("{}{}.", prefix, kFrom);
  std::int64_t reads = 0, makes = 0;
  for (auto it = tensors.lower_bound(from); it != tensors.end() && it->first.starts_with(from); ++it) {
    reads += it->second.size(1);
    makes = it->second.size(0);
  }
  return makes > 0 && IsResidual(reads, makes, !tensors.contains(fmt::format("{}{}.weight", prefix, KeyOfLayer(1))));
}

void Decoder::StartAtZero() {
  torch::NoGradGuard no_grad;
  if (!layers_.empty()) {
    layers_.back()->weight.zero_();
    layers_.back()->bias.zero_();
    return;
  }
  for (Tensor& weight : from_) weight.zero_();
  bias_.zero_();
}

}  // namespace etude::policy
