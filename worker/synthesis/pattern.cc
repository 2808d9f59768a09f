// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/pattern.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace etude::synthesis {

using Eigen::Vector2d;

double Ramp(double low, double high, double x) {
  const double t = std::clamp((x - low) / (high - low), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

void Over(Texel& texel, const Color& color, double coverage) {
  texel.color = Mix(texel.color, color, std::clamp(coverage, 0.0, 1.0));
}

double Fractal(const Vector2d& p, double scale, std::uint32_t seed) {
  double sum = 0;
  for (int octave = 0; octave < 3; ++octave) {
    const double s = scale * (1 << octave);
    sum += assets::Noise(p.x() * s + 31.7 * octave, p.y() * s - 17.3 * octave, seed + octave) / (2 << octave);
  }
  return sum / 0.875;
}

Spot NearestSpot(const Vector2d& p, double spacing, std::uint32_t seed) {
  const Vector2d cell = (p / spacing).array().floor();
  Spot nearest{};
  double best = std::numeric_limits<double>::infinity();
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) {
      // noise at whole numbers is a hash of them
      const Vector2d c = cell + Vector2d(dx, dy);
      const Vector2d jitter(assets::Noise(c.x(), c.y(), seed), assets::Noise(c.x(), c.y(), seed + 1));
      const Vector2d offset = p - spacing * (c + Vector2d(0.15, 0.15) + 0.7 * jitter);
      if (offset.norm() >= best) continue;
      best = offset.norm();
      nearest = {offset, assets::Noise(c.x(), c.y(), seed + 2)};
    }
  return nearest;
}

void Leaf::Paint(const Vector2d& p, double height, Texel& texel) const {
  const Vector2d along(std::cos(angle), std::sin(angle)), across(-along.y(), along.x());
  const double t = (p - root).dot(along) / length;
  if (t <= 0 || t >= 1) return;
  const double side = (p - root).dot(across) / (width * std::pow(std::sin(std::numbers::pi * std::pow(t, 0.8)), 0.8));
  if (std::abs(side) >= 1) return;
  texel.height = std::max(texel.height, height);
  const double stripes = std::abs(std::sin(18 * (t - 0.35 * std::abs(side))));
  const double rib = std::max(Ramp(0.12, 0.04, std::abs(side)), 0.5 * Ramp(0.2, 0.05, stripes));
  texel.color = Mix(color * (1 - 0.2 * std::abs(side)), color * 1.4 + Color(0.08, 0.08, 0), rib).cwiseMin(1);
}

void Stalk::Paint(const Vector2d& p, Texel& texel) const {
  const double share = SegmentDistance(p, a, b) / radius;
  if (share >= 1) return;
  texel.height = std::max(texel.height, radius * Dome(share, 1) + 0.03);
  texel.color = color * (1.15 - 0.5 * share);
}

double Dome(double share, double height) { return share < 1 ? height * std::sqrt(1 - share * share) : 0; }

std::uint32_t NoiseSeed(Rng& rng) { return static_cast<std::uint32_t>(rng.Below(1u << 30)); }

Color Pick(Rng& rng, const std::vector<Color>& colors, double spread) {
  Color color = colors[rng.Below(colors.size())];
  for (int k = 0; k < 3; ++k) color[k] = std::clamp(color[k] + rng.Uniform(-spread, spread), 0.0, 1.0);
  return color;
}

}  // namespace etude::synthesis
