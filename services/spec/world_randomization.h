// SPDX-License-Identifier: Apache-2.0
// How the world changes from episode to episode, so that a policy does not learn the one that it was shown.
#pragma once

#include <string>
#include <vector>

namespace etude {

/// Everything is off by default, and then nothing is drawn. What is drawn is a function of (seed, index), the same for
/// all attempts at an episode; every key has a random stream of its own (those of the camera share one), so that
/// switching one on changes nothing of the others. See services/spec/episode_world.h for what becomes of it.
struct WorldRandomizationSpec {
  double camera_position = 0;       ///< +- m per axis
  double camera_aim = 0;            ///< +- m per axis, of the place on the table that the camera looks at
  double camera_roll = 0;           ///< +- rad about its viewing direction
  double fovy_deg = 0;              ///< +- deg
  double light_brightness = 0;      ///< +- relative
  double light_colour = 0;          ///< +- relative, each channel
  double light_direction = 0;       ///< +- per axis of the sun's unit direction
  std::vector<std::string> tables;  ///< one of them in each episode; none: world.table
  double table_scale = 0;           ///< relative: the table's picture is up to 1 + this larger or smaller
  double table_colour = 0;          ///< +- relative, each channel
  double background = 0;            ///< each channel is drawn from 0 to this, instead of world.background
  double object_colour = 0;         ///< +- relative, each channel of each object
  double object_gloss = 0;          ///< +- of each object's specular reflection and shininess, both 0..1
  int distractors = 0;              ///< at most so many things on the table that no sentence names
  double distractor_balls = 0;      ///< probability that one of them, where there are any, is a ball of some colour

  bool operator==(const WorldRandomizationSpec&) const = default;
  void Visit(auto& v) {
    v("camera_position", camera_position, "m", "the camera is moved by up to +- this along each axis");
    v("camera_aim", camera_aim, "m", "the place on the table that it looks at is moved by up to +- this along x and y");
    v("camera_roll", camera_roll, "rad", "it is turned about its viewing direction by up to +- this");
    v("fovy_deg", fovy_deg, "deg", "its vertical field of view is changed by up to +- this");
    v("light_brightness", light_brightness, "-", "relative change of all lights");
    v("light_colour", light_colour, "-", "relative change of each channel of all lights");
    v("light_direction", light_direction, "-", "the sun's unit direction is changed by up to +- this along each axis");
    v("tables", tables, "", "one of wood, cloth, stone, plain in each episode; none: world.table");
    v("table_scale", table_scale, "-", "the table's picture is enlarged or shrunk by a factor of up to 1 + this");
    v("table_colour", table_colour, "-", "relative change of each channel of the table's picture");
    v("background", background, "-", "each channel of the colour behind the table is drawn from 0 to this");
    v("object_colour", object_colour, "-", "relative change of each channel of each object's colours");
    v("object_gloss", object_gloss, "-", "change of how much each object shines, 0 to 1");
    v("distractors", distractors, "-", "at most so many things on the table that no sentence names");
    v("distractor_balls", distractor_balls, "-",
      "probability that one of them, where there are any, is a ball of some colour");
  }

  bool moves_camera() const { return camera_position > 0 || camera_aim > 0 || camera_roll > 0 || fovy_deg > 0; }
  /// Appends every problem to `errors`. Whether there are distractors and a view is for who knows the whole campaign.
  void Check(std::vector<std::string>& errors) const;
};

}  // namespace etude
