// SPDX-License-Identifier: Apache-2.0
#include "services/spec/world_randomization.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/core/config.h"
#include "services/spec/world_spec.h"

namespace etude {

void WorldRandomizationSpec::Check(std::vector<std::string>& errors) const {
  const auto in_range = [&](const char* key, double value, double high) {
    if (!(value >= 0 && value <= high))
      errors.push_back(fmt::format("randomization.world.{}: {} not in 0..{}", key, value, high));
  };
  in_range("camera_position", camera_position, 1);
  in_range("camera_aim", camera_aim, 0.5);
  in_range("camera_roll", camera_roll, 0.8);
  in_range("fovy_deg", fovy_deg, 40);
  in_range("light_brightness", light_brightness, 0.9);
  in_range("light_colour", light_colour, 0.9);
  in_range("light_direction", light_direction, 1);
  in_range("table_scale", table_scale, 4);
  in_range("table_colour", table_colour, 0.9);
  in_range("background", background, 1);
  in_range("object_colour", object_colour, 0.9);
  in_range("object_gloss", object_gloss, 1);
  in_range("distractors", distractors, 4);
  for (const std::string& table : tables)
    if (std::ranges::find(KnownTables(), table) == KnownTables().end())
      errors.push_back("randomization.world.tables: " + NotKnown(table, KnownTables()));
}

}  // namespace etude
