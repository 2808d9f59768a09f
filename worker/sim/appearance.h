// SPDX-License-Identifier: Apache-2.0
// How the scene looks in one episode: light and colours around those of the scene as described.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "services/core/rng.h"

namespace etude::sim {

/// The default changes nothing.
struct Appearance {
  Eigen::Vector3d light = Eigen::Vector3d::Ones();      ///< gain of every light: red, green, blue
  Eigen::Vector3d sun_shift = Eigen::Vector3d::Zero();  ///< added to the (unit) direction of directional lights
  std::vector<Eigen::Vector3d> tint{};                  ///< gain of the colours of what stands on body i; may be short
};

/// `strength` in 0..1 is the relative change (RandomizationSpec::light); 0 changes and draws nothing.
/// @param bodies  of the scene; the parts of one tree are tinted by their root
Appearance DrawAppearance(double strength, int bodies, Rng& rng);

}  // namespace etude::sim
