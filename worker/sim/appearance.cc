// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/appearance.h"

namespace etude::sim {
namespace {

// Colours change less than brightness: a can that is red stays red.
constexpr double kColour = 0.3, kTint = 0.3, kSun = 0.6;

Eigen::Vector3d Draw(double size, Rng& rng) {
  const double x = rng.Uniform(-size, size), y = rng.Uniform(-size, size), z = rng.Uniform(-size, size);
  return {x, y, z};
}

}  // namespace

Appearance DrawAppearance(double strength, int bodies, Rng& rng) {
  Appearance appearance;
  if (strength <= 0) return appearance;
  const double brightness = 1 + rng.Uniform(-strength, strength);
  appearance.light = brightness * (Eigen::Vector3d::Ones() + Draw(kColour * strength, rng));
  appearance.sun_shift = Draw(kSun * strength, rng);
  for (int body = 0; body < bodies; ++body)
    appearance.tint.push_back(Eigen::Vector3d::Ones() + Draw(kTint * strength, rng));
  return appearance;
}

}  // namespace etude::sim
