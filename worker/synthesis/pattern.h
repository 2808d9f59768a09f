// SPDX-License-Identifier: Apache-2.0
// What the drawings of the built-in classes are put together from: noise, scattered spots, strokes, leaves, outlines.
// Points are in a picture of -1..1, x right, y up. Everything is a pure function of its arguments.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>

#include "services/core/rng.h"
#include "worker/assets/canvas.h"

namespace etude::synthesis {

using assets::Color;

/// What a drawing is at one point.
struct Texel {
  Color color = Color::Zero();
  double height = 0;  ///< of the object's front over the picture's plane, in half widths; <= 0: no object
};
using Drawing = std::function<Texel(const Eigen::Vector2d&)>;

/// 0 below `low`, 1 above `high`, smooth between.
double Ramp(double low, double high, double x);
inline Color Mix(const Color& a, const Color& b, double share_of_b) { return a + share_of_b * (b - a); }
/// Paints over `texel` where `coverage` > 0 (at most 1).
void Over(Texel& texel, const Color& color, double coverage);

/// Three octaves of noise in 0..1 around 0.5; features of about 1 / scale.
double Fractal(const Eigen::Vector2d& p, double scale, std::uint32_t seed);

/// The nearest of points scattered on a jittered grid.
struct Spot {
  Eigen::Vector2d offset;  ///< from it to the asked point
  double random;           ///< 0..1, its own
};
Spot NearestSpot(const Eigen::Vector2d& p, double spacing, std::uint32_t seed);

using assets::SegmentDistance;

/// A pointed leaf that grows from `root` in direction `angle` (rad, 0 along x).
struct Leaf {
  Eigen::Vector2d root;
  double angle = 0;
  double length = 0.4;
  double width = 0.16;
  Color color = {0.25, 0.5, 0.15};

  /// Paints it with ribs, as thick as `height`.
  void Paint(const Eigen::Vector2d& p, double height, Texel& texel) const;
};

/// A stalk from a to b.
struct Stalk {
  Eigen::Vector2d a, b;
  double radius = 0.04;
  Color color = {0.35, 0.22, 0.1};

  void Paint(const Eigen::Vector2d& p, Texel& texel) const;
};

/// Height of a dome over an outline: `share` is the place between its middle (0) and its outline (1).
double Dome(double share, double height);

/// A random seed of noise.
std::uint32_t NoiseSeed(Rng& rng);
/// One of the colours, slightly changed.
Color Pick(Rng& rng, const std::vector<Color>& colors, double spread = 0.04);

}  // namespace etude::synthesis
