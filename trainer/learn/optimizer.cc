// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/optimizer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>

#include "services/core/check.h"
#include "trainer/learn/flat.h"
#include "trainer/policy/parts.h"

namespace etude::learn {
namespace {

// a view into `flat` with the shape and the (dense, maybe channels-last) strides of `like`
torch::Tensor ViewLike(const torch::Tensor& flat, std::size_t offset, const torch::Tensor& like) {
  return flat.as_strided(like.sizes(), like.strides(), static_cast<std::int64_t>(offset));
}

}  // namespace

double LearningRate(const OptimizerConfig& config, std::uint64_t step, double progress) {
  const double warmup =
      config.warmup_steps > 0 ? std::min(1.0, (static_cast<double>(step) + 1) / config.warmup_steps) : 1.0;
  if (config.schedule == "constant") return config.lr * warmup;
  const double cosine = 0.5 * (1 + std::cos(std::numbers::pi * std::clamp(progress, 0.0, 1.0)));
  return config.lr * warmup * (config.final_lr + (1 - config.final_lr) * cosine);
}

Optimizer::Optimizer(const OptimizerConfig& config, std::vector<std::shared_ptr<policy::Policy>> replicas)
    : config_(config) {
  const torch::NoGradGuard no_grad;
  std::size_t total = 0;
  for (const auto& item : replicas.at(0)->named_parameters()) {
    if (!item.value().requires_grad()) continue;
    ETUDE_CHECK(item.value().scalar_type() == torch::kFloat32 && item.value().is_non_overlapping_and_dense(), "{}",
                item.key());
    const auto count = static_cast<std::size_t>(item.value().numel());
    segments_.push_back({item.key(), policy::PartOfTensor(item.key()), total, count, item.value().dim() >= 2,
                         item.value().sizes().vec(), item.value().strides().vec()});
    total += (count + 15) / 16 * 16;  // 64-byte alignment of each
  }
  copies_ = static_cast<int>(replicas.size());
  const auto options = torch::TensorOptions().dtype(torch::kFloat32).device(replicas.front()->device());
  parameters_ = torch::zeros(static_cast<std::int64_t>(total), options);
  first_ = torch::zeros_like(parameters_);
  second_ = torch::zeros_like(parameters_);
  steps_ = torch::zeros(static_cast<std::int64_t>(segments_.size()), torch::kInt64);

  for (std::size_t r = 0; r < replicas.size(); ++r) {
    gradients_.push_back(torch::zeros_like(parameters_));
    auto named = replicas[r]->named_parameters();
    for (const auto& segment : segments_) {
      auto& parameter = named[segment.name];
      auto view = ViewLike(parameters_, segment.offset, parameter);
      if (r == 0) view.copy_(parameter);
      parameter.set_data(view);
      parameter.mutable_grad() = ViewLike(gradients_[r], segment.offset, parameter);
    }
  }
}

std::size_t Optimizer::size() const {
  std::size_t total = 0;
  for (const auto& segment : segments_) total += segment.count;
  return total;
}

void Optimizer::ZeroGradients() {
  const torch::NoGradGuard no_grad;
  for (auto& gradient : gradients_) gradient.zero_();
  summed_ = false;
}

torch::Tensor& Optimizer::SumGradients() {
  for (std::size_t r = 1; r < gradients_.size() && !summed_; ++r) AddFlat(gradients_[r], gradients_[0]);
  summed_ = true;
  return gradients_[0];
}

AdamwStep Optimizer::NextStep(std::size_t segment, double lr, double scale) {
  const auto t = static_cast<double>(++steps_.data_ptr<std::int64_t>()[segment]);
  AdamwStep step;
  step.lr = static_cast<float>(lr);
  step.beta1 = static_cast<float>(config_.beta1);
  step.beta2 = static_cast<float>(config_.beta2);
  step.epsilon = static_cast<float>(config_.epsilon);
  step.decay = segments_[segment].decay ? static_cast<float>(config_.weight_decay) : 0.0f;
  step.correction1 = static_cast<float>(1 - std::pow(config_.beta1, t));
  step.correction2 = static_cast<float>(1 - std::pow(config_.beta2, t));
  step.scale = static_cast<float>(scale);
  return step;
}

Optimizer::Outcome Optimizer::Step(double lr) {
  const torch::Tensor& gradient = SumGradients();
  std::vector<FlatRange> ranges;
  for (const auto& segment : segments_) ranges.push_back({segment.offset, segment.count});
  const std::vector<double> squares = SquaresOf(gradient, ranges);
  const double total = std::accumulate(squares.begin(), squares.end(), 0.0);
  const double average = 1.0 / copies_;
  Outcome outcome{std::sqrt(total) * average, {}};
  const double norm = outcome.gradient_norm;
  if (!std::isfinite(norm)) return outcome;
  for (std::size_t i = 0; i < segments_.size(); ++i)
    if (squares[i] != 0) outcome.part_norms[segments_[i].part] += squares[i];
  for (auto& [part, value] : outcome.part_norms) value = std::sqrt(value) * average;

  const double clip = config_.clip > 0 && norm > config_.clip ? config_.clip / norm : 1.0;
  std::vector<std::optional<AdamwStep>> steps(segments_.size());
  for (std::size_t i = 0; i < segments_.size(); ++i)
    if (squares[i] != 0) steps[i] = NextStep(i, lr, clip * average);
  UpdateFlat(ranges, steps, {gradient, first_, second_, parameters_});
  return outcome;
}

void Optimizer::UpdateAverage(double decay) {
  if (decay <= 0) {
    average_ = average_steps_ = torch::Tensor();
    return;
  }
  if (!average_.defined()) {
    average_ = parameters_.clone();
    average_steps_ = torch::zeros(1, torch::kInt64);
  }
  ++average_steps_.data_ptr<std::int64_t>()[0];
  // Early on the average is short, so that the start does not weigh on it: by the steps of each parameter itself, since
  // a module of a later stage begins when the run has long gone on.
  const auto decay_of = [&](std::size_t segment) {
    const auto t = static_cast<double>(steps_.data_ptr<std::int64_t>()[segment]);
    return std::min(decay, (1 + t) / (10 + t));
  };
  for (std::size_t i = 0, next = 0; i < segments_.size(); i = next) {
    const double now = decay_of(i);
    for (next = i + 1; next < segments_.size() && decay_of(next) == now;) ++next;
    const auto begin = static_cast<std::int64_t>(segments_[i].offset);
    const auto end = static_cast<std::int64_t>(segments_[next - 1].offset + segments_[next - 1].count);
    torch::Tensor average = average_.narrow(0, begin, end - begin);
    AverageFlat(now, parameters_.narrow(0, begin, end - begin), average);
  }
}

void Optimizer::ExchangeAverage() {
  if (average_.defined()) SwapFlat(parameters_, average_);
}

torch::Tensor Optimizer::ViewOf(const torch::Tensor& flat, const Segment& segment) const {
  return flat.as_strided(segment.sizes, segment.strides, static_cast<std::int64_t>(segment.offset));
}

std::map<std::string, torch::Tensor> Optimizer::StateTensors() const {
  std::map<std::string, torch::Tensor> tensors;
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    const Segment& segment = segments_[i];
    tensors["first/" + segment.name] = ViewOf(first_, segment);
    tensors["second/" + segment.name] = ViewOf(second_, segment);
    tensors["steps/" + segment.name] = steps_.narrow(0, static_cast<std::int64_t>(i), 1);
    if (average_.defined()) tensors["average/" + segment.name] = ViewOf(average_, segment);
  }
  if (average_.defined()) tensors["average_steps"] = average_steps_;
  return tensors;
}

Status Optimizer::LoadStateTensors(const std::map<std::string, torch::Tensor>& tensors) {
  const torch::NoGradGuard no_grad;
  const auto known = [&](const std::string& name) { return tensors.contains("first/" + name); };
  const auto own = StateTensors();
  for (const auto& [name, tensor] : own) {
    const auto slash = name.find('/');
    if (slash == std::string::npos || name.starts_with("average") || !known(name.substr(slash + 1))) continue;
    const auto it = tensors.find(name);
    if (it == tensors.end() || it->second.sizes() != tensor.sizes() || it->second.scalar_type() != tensor.scalar_type())
      return Fail(Code::kCorrupt, fmt::format("optimizer state '{}' is missing or has another size", name));
  }
  const bool averaged = tensors.contains("average_steps");
  for (const Segment& segment : segments_) {
    const auto it = tensors.find("average/" + segment.name);
    if (averaged && known(segment.name) && (it == tensors.end() || it->second.sizes().vec() != segment.sizes))
      return Fail(Code::kCorrupt,
                  fmt::format("optimizer state 'average/{}' is missing or has another size", segment.name));
  }
  for (const auto& [name, tensor] : own)
    if (const auto it = tensors.find(name); it != tensors.end() && !name.starts_with("average"))
      torch::Tensor(tensor).copy_(it->second);
  if (!averaged) return {};
  // what has no average yet begins at what it is
  average_ = parameters_.clone();
  average_steps_ = tensors.at("average_steps").clone();
  for (const Segment& segment : segments_)
    if (const auto it = tensors.find("average/" + segment.name); it != tensors.end())
      ViewOf(average_, segment).copy_(it->second);
  return {};
}

}  // namespace etude::learn
