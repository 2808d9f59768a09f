// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/appearance.h"

#include "worker/sim/model.h"

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

Appearance WithWorld(Appearance appearance, const EpisodeWorld& world, const Scene& scene) {
  const auto vector = [](const Rgb& values) { return Eigen::Vector3d(values[0], values[1], values[2]); };
  appearance.light = appearance.light.cwiseProduct(vector(world.light));
  appearance.sun_shift += vector(world.sun_shift);
  appearance.table = world.table;
  appearance.table_scale = world.table_scale;
  appearance.table_colour = vector(world.table_colour);
  if (world.background) appearance.background = vector(*world.background);
  const auto bodies = static_cast<std::size_t>(scene.body_count());
  for (const auto& [name, gain] : world.colour) {
    appearance.tint.resize(bodies, Eigen::Vector3d::Ones());
    Eigen::Vector3d& tint = appearance.tint[static_cast<std::size_t>(scene.model().BodyId(name))];
    tint = tint.cwiseProduct(vector(gain));
  }
  for (const auto& [name, change] : world.gloss) {
    appearance.gloss.resize(bodies, 0.0);
    appearance.gloss[static_cast<std::size_t>(scene.model().BodyId(name))] = change;
  }
  return appearance;
}

}  // namespace etude::sim
