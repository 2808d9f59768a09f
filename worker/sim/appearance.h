// SPDX-License-Identifier: Apache-2.0
// How the scene looks in one episode: light and colours around those of the scene as described. Nothing of it needs
// another compiled scene.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "services/core/rng.h"
#include "services/spec/episode_world.h"

namespace etude::sim {

class Scene;

/// The default changes nothing.
struct Appearance {
  Eigen::Vector3d light = Eigen::Vector3d::Ones();      ///< gain of every light: red, green, blue
  Eigen::Vector3d sun_shift = Eigen::Vector3d::Zero();  ///< added to the (unit) direction of directional lights
  std::vector<Eigen::Vector3d> tint{};                  ///< gain of the colours of what stands on body i; may be short
  std::vector<double> gloss{};  ///< added to its specular reflection and shininess; may be short
  std::string table{};          ///< picture on the table, by name; "" is the scene's own
  double table_scale = 1;       ///< the picture is so much larger
  Eigen::Vector3d table_colour = Eigen::Vector3d::Ones();  ///< gain of the picture
  std::optional<Eigen::Vector3d> background{};             ///< colour behind the table, 0..1; none: the scene's own
};

/// `strength` in 0..1 is the relative change (RandomizationSpec::light); 0 changes and draws nothing.
/// @param bodies  of the scene; the parts of one tree are tinted by their root
Appearance DrawAppearance(double strength, int bodies, Rng& rng);

/// `appearance` with what was drawn for an episode of its scene on top.
Appearance WithWorld(Appearance appearance, const EpisodeWorld& world, const Scene& scene);

}  // namespace etude::sim
