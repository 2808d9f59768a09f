// SPDX-License-Identifier: Apache-2.0
#include "services/spec/world_spec.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "services/core/config.h"

namespace etude {

const std::vector<std::string>& KnownTables() {
  static const std::vector<std::string> tables{"wood", "cloth", "stone", "plain"};
  return tables;
}

void WorldSpec::Check(std::vector<std::string>& errors) const {
  const auto in_range = [&](const char* key, double value, double low, double high) {
    if (!(value >= low && value <= high))
      errors.push_back(fmt::format("world.{}: {} not in {}..{}", key, value, low, high));
  };
  const auto colour = [&](const char* key, const std::vector<double>& values, double high) {
    if (values.size() != 3) errors.push_back(fmt::format("world.{}: three numbers", key));
    for (double value : values) in_range(key, value, 0, high);
  };
  in_range("light_brightness", light_brightness, 0.1, 4);
  colour("light_colour", light_colour, 4);
  colour("table_colour", table_colour, 4);
  colour("object_colour", object_colour, 4);
  colour("background", background, 1);
  in_range("friction", friction, 0.1, 4);
  in_range("control_delay", control_delay, 0, 50);
  const bool shines_down =
      light_direction.size() == 3 && light_direction[2] < 0 &&
      std::all_of(light_direction.begin(), light_direction.end(), [](double value) { return std::isfinite(value); });
  if (!shines_down) errors.push_back("world.light_direction: three numbers, the last < 0");
  if (std::ranges::find(KnownTables(), table) == KnownTables().end())
    errors.push_back("world.table: " + NotKnown(table, KnownTables()));
}

}  // namespace etude
