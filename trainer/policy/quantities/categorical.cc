// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/quantities/categorical.h"

#include <algorithm>
#include <cmath>

namespace etude::policy {

using torch::Tensor;

const Tensor& Categorical::LogitsOf(const ModuleOutput& output) const { return output.decoded.at(std::string(name())); }

void Categorical::FillName(std::span<const std::string> names, std::string_view name, std::span<float> values,
                           std::span<std::uint8_t> valid) {
  const auto known = std::find(names.begin(), names.end(), name);
  if (known == names.end()) return;
  values[0] = static_cast<float>(known - names.begin());
  valid[0] = 1;
}

void Categorical::Decode(const Head&, const Decoding&, const Tensor& raw, ModuleOutput& output) const {
  output.decoded[std::string(name())] = raw;
}

Tensor Categorical::Feature(const ModuleOutput& output, const Normalization&, bool, bool detach) const {
  const Tensor probability = torch::softmax(LogitsOf(output), -1);
  return detach ? probability.detach() : probability;
}

Tensor Categorical::Loss(const Head&, const LossesConfig& losses, const ModuleOutput& output, const Target& target,
                         const PictureView&) const {
  const Tensor& logits = LogitsOf(output);
  const auto sentences = std::max(logits.size(1), target.value.size(1));
  const Tensor log_p = torch::log_softmax(logits, -1).expand({logits.size(0), sentences, logits.size(2)});
  const Tensor index = target.Clean().to(torch::kInt64).expand({logits.size(0), sentences});
  const Masked masked{-log_p.gather(-1, index.unsqueeze(-1)).squeeze(-1), target.valid};
  return losses.class_.weight * masked.Mean();
}

std::vector<Metric> Categorical::Measure(const Head&, const ModuleOutput& output, const Target& target) const {
  const Tensor same = LogitsOf(output).argmax(-1) == target.value.to(torch::kInt64);
  return {{"accuracy", same, target.valid, 1, Metric::Role::kAccuracy}};
}

void Categorical::Say(const Head& head, const ModuleOutput& output, OrderedJson& words) const {
  const Tensor logits = LogitsOf(output).select(0, 0).select(0, 0).to(torch::kCPU, torch::kFloat32);
  const Tensor probability = torch::softmax(logits, -1);
  const auto best = probability.argmax(-1).item<std::int64_t>();
  words["value"] = head.classes.at(static_cast<std::size_t>(best));
  words["probability"] = std::round(probability[best].item<double>() * 1e5) / 1e5;
}

}  // namespace etude::policy
