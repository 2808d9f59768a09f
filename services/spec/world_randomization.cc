// SPDX-License-Identifier: Apache-2.0
#include "services/spec/world_randomization.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/core/config.h"
#include "services/spec/world_spec.h"

namespace etude {

void WorldRandomizationSpec::Check(std::vector<std::string>& errors) const {
  struct Range {
    const char* key;
    double value, high;
  };
  for (const Range& range : {Range{"camera_position", camera_position, 1},
                             {"camera_aim", camera_aim, 0.5},
                             {"camera_roll", camera_roll, 0.8},
                             {"fovy_deg", fovy_deg, 40},
                             {"light_brightness", light_brightness, 0.9},
                             {"light_colour", light_colour, 0.9},
                             {"light_direction", light_direction, 1},
                             {"table_scale", table_scale, 4},
                             {"table_colour", table_colour, 0.9},
                             {"background", background, 1},
                             {"object_colour", object_colour, 0.9},
                             {"object_gloss", object_gloss, 1},
                             {"distractors", static_cast<double>(distractors), 4},
                             {"distractor_balls", distractor_balls, 1}})
    if (!(range.value >= 0 && range.value <= range.high))
      errors.push_back(fmt::format("randomization.world.{}: {} not in 0..{}", range.key, range.value, range.high));
  for (const std::string& table : tables)
    if (std::ranges::find(KnownTables(), table) == KnownTables().end())
      errors.push_back("randomization.world.tables: " + NotKnown(table, KnownTables()));
}

}  // namespace etude
