// SPDX-License-Identifier: Apache-2.0
// How a campaign's world departs from the nominal one: a stand-in for moving a policy to another bench.
#pragma once

#include <string>
#include <vector>

namespace etude {

/// wood, cloth, stone, plain
const std::vector<std::string>& KnownTables();

/// The same for all episodes of a campaign (RandomizationSpec has what changes between episodes; the
/// camera's place is CameraSpec's). The defaults are the nominal world, byte for byte.
struct WorldSpec {
  double light_brightness = 1;                            ///< gain of all lights
  std::vector<double> light_colour{1, 1, 1};              ///< gain of all lights: red, green, blue
  std::vector<double> light_direction{-0.10, -0.45, -1};  ///< where the sun shines, world
  std::string table = "wood";                             ///< wood | cloth | stone | plain
  std::vector<double> table_colour{1, 1, 1};              ///< gain of the table's picture
  std::vector<double> object_colour{1, 1, 1};             ///< gain of every object's colours
  std::vector<double> background{0, 0, 0};                ///< colour behind the table, 0..1
  double friction = 1;                                    ///< factor of all sliding friction
  int control_delay = 0;                                  ///< control steps until a command takes effect

  void Visit(auto& v) {
    v("light_brightness", light_brightness, "-", "gain of all lights");
    v("light_colour", light_colour, "-", "gain of all lights: red, green, blue");
    v("light_direction", light_direction, "-", "where the sun shines: a direction, world");
    v("table", table, "", "wood | cloth | stone | plain");
    v("table_colour", table_colour, "-", "gain of the table's picture: red, green, blue");
    v("object_colour", object_colour, "-", "gain of every object's colours: red, green, blue");
    v("background", background, "-", "colour behind the table, 0 to 1: red, green, blue");
    v("friction", friction, "-", "factor of all sliding friction");
    v("control_delay", control_delay, "steps of 8 ms", "control steps until a command takes effect");
  }

  bool operator==(const WorldSpec&) const = default;
  /// Appends every problem to `errors`.
  void Check(std::vector<std::string>& errors) const;
};

}  // namespace etude
