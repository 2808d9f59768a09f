// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/flat.h"

#include <algorithm>

#include "trainer/policy/device.h"

namespace etude::learn {
namespace {

using torch::Tensor;

bool UsesOwnKernels(const Tensor& flat) { return policy::UsesOwnKernels(flat.device()); }

std::size_t SizeOf(const Tensor& flat) { return static_cast<std::size_t>(flat.numel()); }

// What a step is of each number: rows of a table, so that ranges become columns and one operation works on all.
enum Row { kBeta1, kBeta2, kKeep, kRate, kInverse2, kScale, kEpsilon, kRows };

// A range that is left alone multiplies by 1 and adds 0.
Tensor TableOf(const std::vector<std::optional<AdamwStep>>& steps) {
  Tensor table = torch::zeros({kRows, static_cast<std::int64_t>(steps.size())});
  auto at = table.accessor<float, 2>();
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const auto column = static_cast<std::int64_t>(i);
    at[kBeta1][column] = at[kBeta2][column] = at[kKeep][column] = at[kEpsilon][column] = 1;
    if (!steps[i]) continue;
    const AdamwStep& step = *steps[i];
    at[kBeta1][column] = step.beta1;
    at[kBeta2][column] = step.beta2;
    at[kKeep][column] = 1 - step.lr * step.decay;
    at[kRate][column] = step.lr / step.correction1;
    at[kInverse2][column] = 1 / step.correction2;
    at[kScale][column] = step.scale;
    at[kEpsilon][column] = step.epsilon;
  }
  return table;
}

// Numbers of each range and of the padding behind it.
Tensor WidthsOf(const std::vector<FlatRange>& ranges, std::int64_t total) {
  std::vector<std::int64_t> widths;
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    const auto end = i + 1 < ranges.size() ? static_cast<std::int64_t>(ranges[i + 1].offset) : total;
    widths.push_back(end - static_cast<std::int64_t>(ranges[i].offset));
  }
  return torch::tensor(widths, torch::kInt64);
}

void UpdateByTorch(const std::vector<FlatRange>& ranges, const std::vector<std::optional<AdamwStep>>& steps,
                   const AdamwBuffers& buffers) {
  const torch::NoGradGuard no_grad;
  const std::int64_t total = buffers.parameters.numel();
  const torch::Device device = buffers.parameters.device();
  const Tensor widths = policy::ToDevice(WidthsOf(ranges, total), device);
  const Tensor table = policy::ToDevice(TableOf(steps), device).repeat_interleave(widths, 1, total);
  const auto row = [&](Row i) { return table.select(0, i); };
  const Tensor gradient = buffers.gradient * row(kScale);
  buffers.first.mul_(row(kBeta1)).add_((1 - row(kBeta1)) * gradient);
  buffers.second.mul_(row(kBeta2)).add_((1 - row(kBeta2)) * gradient * gradient);
  const Tensor size = (buffers.second * row(kInverse2)).sqrt_().add_(row(kEpsilon));
  buffers.parameters.mul_(row(kKeep)).sub_(row(kRate) * buffers.first / size);
}

}  // namespace

void AddFlat(const Tensor& from, Tensor& into) {
  const torch::NoGradGuard no_grad;
  if (UsesOwnKernels(into))
    AddInto(SizeOf(into), from.data_ptr<float>(), into.data_ptr<float>());
  else
    into.add_(from);
}

std::vector<double> SquaresOf(const Tensor& flat, const std::vector<FlatRange>& ranges) {
  std::vector<double> squares;
  if (ranges.empty()) return squares;
  if (UsesOwnKernels(flat)) {
    for (const FlatRange& range : ranges)
      squares.push_back(SumOfSquares(flat.data_ptr<float>() + range.offset, range.count));
    return squares;
  }
  const torch::NoGradGuard no_grad;
  std::vector<Tensor> parts;
  for (const FlatRange& range : ranges)
    parts.push_back(flat.narrow(0, static_cast<std::int64_t>(range.offset), static_cast<std::int64_t>(range.count)));
  // one transfer for all
  const Tensor norms = torch::stack(at::_foreach_norm(parts)).to(torch::kCPU, torch::kFloat64).square();
  squares.assign(norms.data_ptr<double>(), norms.data_ptr<double>() + norms.numel());
  return squares;
}

void AverageFlat(double decay, const Tensor& value, Tensor& average) {
  const torch::NoGradGuard no_grad;
  if (UsesOwnKernels(average))
    Average(SizeOf(average), static_cast<float>(decay), value.data_ptr<float>(), average.data_ptr<float>());
  else
    average.mul_(decay).add_(value, 1 - decay);
}

void SwapFlat(Tensor& a, Tensor& b) {
  const torch::NoGradGuard no_grad;
  if (UsesOwnKernels(a)) {
    std::swap_ranges(a.data_ptr<float>(), a.data_ptr<float>() + a.numel(), b.data_ptr<float>());
    return;
  }
  const Tensor kept = a.clone();
  a.copy_(b);
  b.copy_(kept);
}

void UpdateFlat(const std::vector<FlatRange>& ranges, const std::vector<std::optional<AdamwStep>>& steps,
                const AdamwBuffers& buffers) {
  if (!UsesOwnKernels(buffers.parameters)) return UpdateByTorch(ranges, steps, buffers);
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    if (!steps[i]) continue;
    const std::size_t at = ranges[i].offset;
    UpdateAdamw(*steps[i], ranges[i].count, buffers.gradient.data_ptr<float>() + at,
                buffers.first.data_ptr<float>() + at, buffers.second.data_ptr<float>() + at,
                buffers.parameters.data_ptr<float>() + at);
  }
}

}  // namespace etude::learn
