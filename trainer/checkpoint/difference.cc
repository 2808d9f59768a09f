// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/difference.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "trainer/policy/parts.h"

namespace etude::checkpoint {
namespace {

using Tensors = std::map<std::string, torch::Tensor>;

constexpr char kStatisticsPart[] = "normalization";

Tensors TensorsOf(const Checkpoint& checkpoint, const std::string& part) {
  Tensors found;
  for (const auto& [name, tensor] : checkpoint.tensors) {
    const std::string own = policy::PartOfTensor(name);
    if ((own.empty() ? kStatisticsPart : own) == part) found[name] = tensor;
  }
  return found;
}

std::string ShapeOf(const Tensors& tensors, const std::string& name) {
  const auto found = tensors.find(name);
  return found == tensors.end() ? "absent" : fmt::format("({})", fmt::join(found->second.sizes(), ", "));
}

PartDifference ComparePart(const std::string& part, const Tensors& first, const Tensors& second) {
  using State = PartDifference::State;
  PartDifference result{part};
  for (const auto& [name, tensor] : second.empty() ? first : second) result.numbers += tensor.numel();
  if (first.empty() || second.empty()) {
    result.state = first.empty() ? State::kOnlyInSecond : State::kOnlyInFirst;
    return result;
  }
  Tensors all = first;
  all.insert(second.begin(), second.end());
  double moved = 0, length = 0;
  bool same = true;
  for (const auto& [name, unused] : all) {
    const auto a = first.find(name), b = second.find(name);
    if (a == first.end() || b == second.end() || a->second.sizes() != b->second.sizes()) {
      result.tensors.push_back(fmt::format("{} {} -> {}", name, ShapeOf(first, name), ShapeOf(second, name)));
      continue;
    }
    // torch::equal throws for numbers of two types
    same = same && a->second.scalar_type() == b->second.scalar_type() && torch::equal(a->second, b->second);
    moved += (b->second.to(torch::kFloat64) - a->second.to(torch::kFloat64)).square().sum().item<double>();
    length += a->second.to(torch::kFloat64).square().sum().item<double>();
  }
  result.relative = length > 0 ? std::sqrt(moved / length) : 0;
  result.state = !result.tensors.empty() ? State::kReshaped : same ? State::kSame : State::kChanged;
  return result;
}

}  // namespace

std::vector<PartDifference> Compare(const Checkpoint& first, const Checkpoint& second) {
  std::vector<std::string> parts = policy::PartsOf(first.metadata.policy);
  for (const auto& part : policy::PartsOf(second.metadata.policy))
    if (std::find(parts.begin(), parts.end(), part) == parts.end()) parts.push_back(part);
  parts.emplace_back(kStatisticsPart);
  std::vector<PartDifference> differences;
  for (const auto& part : parts)
    differences.push_back(ComparePart(part, TensorsOf(first, part), TensorsOf(second, part)));
  return differences;
}

std::string ToText(const std::vector<PartDifference>& differences) {
  using State = PartDifference::State;
  std::string text = fmt::format("{:<16} {:>9}  {}\n", "part", "numbers", "change");
  for (const auto& item : differences) {
    std::string change;
    switch (item.state) {
      case State::kSame:
        change = "none, bit for bit";
        break;
      case State::kChanged:
        change = fmt::format("by {:.3g} % of its length", 100 * item.relative);
        break;
      case State::kReshaped:
        change = fmt::format("another shape: {}; what both have by {:.3g} %", fmt::join(item.tensors, ", "),
                             100 * item.relative);
        break;
      case State::kOnlyInFirst:
        change = "only in the first";
        break;
      case State::kOnlyInSecond:
        change = "only in the second";
        break;
    }
    text += fmt::format("{:<16} {:>9}  {}\n", item.part, item.numbers, change);
  }
  return text;
}

}  // namespace etude::checkpoint
