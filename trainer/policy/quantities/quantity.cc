// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/quantities/quantity.h"

#include <fmt/format.h>
#include <torch/types.h>

#include "services/core/check.h"
#include "trainer/policy/quantities/list.h"

namespace etude::policy {
namespace {

const std::vector<const Quantity*>& All() {
  static const std::vector<const Quantity*> all = ListQuantities();
  return all;
}

}  // namespace

const Quantity* FindQuantity(std::string_view name) {
  for (const Quantity* quantity : All())
    if (quantity->name() == name) return quantity;
  return nullptr;
}

const std::vector<std::string>& QuantityNames() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> result;
    for (const Quantity* quantity : All()) result.emplace_back(quantity->name());
    return result;
  }();
  return names;
}

at::Tensor Quantity::Feature(const ModuleOutput&, const Normalization&, bool, bool) const {
  ETUDE_CHECK(false, "a {} is no decoder's input", name());
}

void LossesConfig::Check(std::vector<std::string>& errors) const {
  const auto require = [&](bool good, std::string message) {
    if (!good) errors.push_back("losses." + std::move(message));
  };
  require(attention.kind == "log" || attention.kind == "mse" || attention.kind == "mse_each",
          fmt::format("attention.kind: '{}' is not one of log, mse, mse_each", attention.kind));
  require(attention.patch_sigma > 0, "attention.patch_sigma: must be > 0");
  const std::pair<const char*, const SmoothL1Config*> smooth[] = {{"pixel", &pixel},
                                                                  {"position", &position},
                                                                  {"displacement", &displacement},
                                                                  {"rotation", &rotation},
                                                                  {"waypoint", &waypoint}};
  for (const auto& [name, loss] : smooth) {
    require(loss->weight >= 0, fmt::format("{}.weight: must be >= 0", name));
    require(loss->beta > 0, fmt::format("{}.beta: must be > 0", name));
  }
  require(class_.weight >= 0 && gripper.weight >= 0, "class.weight, gripper.weight: must be >= 0");
}

}  // namespace etude::policy
