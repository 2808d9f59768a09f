// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "worker/synthesis/drawings.h"

namespace etude::synthesis {
namespace {

using Eigen::Vector2d;
using std::numbers::pi;

/// A wavy line of a few waves: the sum of three sines.
struct Waves {
  double amplitude[3], phase[3];
  int count[3];

  static Waves Make(Rng& rng, double amplitude, int slowest) {
    Waves waves;
    for (int k = 0; k < 3; ++k) {
      waves.amplitude[k] = amplitude * rng.Uniform(0.4, 1.0) / (k + 1);
      waves.phase[k] = rng.Uniform(0, 2 * pi);
      waves.count[k] = slowest + static_cast<int>(rng.Below(3)) + 3 * k;
    }
    return waves;
  }
  double At(double angle) const {
    double sum = 0;
    for (int k = 0; k < 3; ++k) sum += amplitude[k] * std::sin(count[k] * angle + phase[k]);
    return sum;
  }
};

/// Short rods scattered over the picture: at most one at `p`; its colour, or nothing.
bool Sprinkle(const Vector2d& p, double spacing, std::uint32_t seed, double& random) {
  const Spot spot = NearestSpot(p, spacing, seed);
  const double angle = spot.random * 40;
  const Vector2d half = 0.30 * spacing * Vector2d(std::cos(angle), std::sin(angle));
  random = spot.random * 7 - std::floor(spot.random * 7);
  return SegmentDistance(spot.offset, -half, half) < 0.11 * spacing;
}

}  // namespace

Drawing DrawDonut(Rng& rng) {
  const double tube = rng.Uniform(0.26, 0.32), middle = rng.Uniform(0.53, 0.57), plump = rng.Uniform(1.40, 1.60);
  const Waves outer = Waves::Make(rng, 0.035, 4), inner = Waves::Make(rng, 0.03, 3);
  const Color dough = Pick(rng, {{.84, .60, .30}, {.76, .50, .22}, {.90, .70, .42}}, 0.03);
  const Color icing =
      Pick(rng, {{.95, .52, .68}, {.36, .18, .09}, {.97, .94, .88}, {.96, .82, .36}, {.52, .78, .86}, {.66, .46, .80}});
  const int topping = static_cast<int>(rng.Below(4));  // none, bright sprinkles, dark sprinkles, drizzle
  const double drizzle_turn = rng.Uniform(0, pi), spacing = rng.Uniform(0.11, 0.15);
  const std::uint32_t seed = NoiseSeed(rng);
  const std::vector<Color> bright{{.95, .20, .25}, {.98, .85, .20}, {.25, .60, .90}, {.30, .75, .35}, {1, 1, 1}};
  const bool is_dark = icing.sum() < 1.2;

  return [=](const Vector2d& p) {
    Texel texel;
    const double rho = std::hypot(p.x() / 0.90, p.y()), angle = std::atan2(p.y(), p.x());
    const double off = (rho - middle) / tube;
    if (std::abs(off) >= 1) return texel;
    texel.height = plump * tube * std::cbrt(1 - std::pow(std::abs(off), 3));
    texel.color = Mix(dough, dough * 0.78, Fractal(p, 5, seed));
    Over(texel, {.95, .82, .58}, 0.7 * Ramp(0.80, 0.90, std::abs(off)));
    const double iced = std::min(0.68 + outer.At(angle) / tube - off, off + 0.66 + inner.At(angle) / tube);
    Over(texel, icing, Ramp(-0.02, 0.02, iced));
    texel.height += 0.03 * Ramp(-0.02, 0.14, iced);
    if (iced < 0.12) return texel;
    double random = 0;
    if (topping == 1 || topping == 2) {
      if (Sprinkle(p, spacing, seed + 5, random)) {
        const Color plain = is_dark ? Color(.97, .94, .88) : Color(.32, .16, .08);
        Over(texel, topping == 1 ? bright[static_cast<std::size_t>(random * 5) % 5] : plain, 1);
      }
    } else if (topping == 3) {
      const double across = p.x() * std::cos(drizzle_turn) + p.y() * std::sin(drizzle_turn);
      const double along = p.y() * std::cos(drizzle_turn) - p.x() * std::sin(drizzle_turn);
      const double line = std::abs(std::sin(15 * across + 0.8 * std::sin(5 * along)));
      Over(texel, is_dark ? Color(.97, .92, .84) : Color(.34, .17, .09), Ramp(0.34, 0.24, line));
    }
    return texel;
  };
}

namespace {

/// The baker's cuts in a loaf: one long one, a cross, slanted ones or a square.
std::vector<std::pair<Vector2d, Vector2d>> Scores(int pattern, double length, double width) {
  std::vector<std::pair<Vector2d, Vector2d>> scores;
  const double l = 0.72 * length, w = 0.66 * width;
  if (pattern == 0) scores = {{{-l, -0.05}, {l, 0.05}}};
  if (pattern == 1) scores = {{{-l, 0}, {l, 0}}, {{0, -w}, {0, w}}};
  if (pattern == 2)
    for (int i = -1; i <= 1; ++i) scores.push_back({{0.42 * i - 0.16, -0.75 * w}, {0.42 * i + 0.16, 0.75 * w}});
  if (pattern == 3) {
    const double s = 0.55 * w;
    scores = {{{-s, -1.5 * s}, {-s, 1.5 * s}},
              {{s, -1.5 * s}, {s, 1.5 * s}},
              {{-1.5 * s, -s}, {1.5 * s, -s}},
              {{-1.5 * s, s}, {1.5 * s, s}}};
  }
  return scores;
}

}  // namespace

Drawing DrawSourdough(Rng& rng) {
  const double length = rng.Uniform(0.78, 0.90), width = rng.Uniform(0.58, 0.68), high = rng.Uniform(0.50, 0.60);
  const Waves lumps = Waves::Make(rng, 0.012, 2);
  const Color crust = Pick(rng, {{.66, .40, .16}, {.55, .30, .12}, {.76, .52, .24}, {.46, .25, .11}}, 0.03);
  const Color crumb = Pick(rng, {{.95, .86, .66}, {.92, .78, .52}}, 0.02);
  const int pattern = static_cast<int>(rng.Below(4));
  const double turn = rng.Uniform(-0.25, 0.25), flour = rng.Uniform(0.25, 0.8), score_width = rng.Uniform(0.045, 0.07);
  const std::uint32_t seed = NoiseSeed(rng);

  const auto scores = Scores(pattern, length, width);

  return [=](const Vector2d& upright) {
    Texel texel;
    const Vector2d p(upright.y(), -upright.x());  // it stands on an end
    const Vector2d q(std::cos(turn) * p.x() + std::sin(turn) * p.y(), std::cos(turn) * p.y() - std::sin(turn) * p.x());
    const Vector2d unit(q.x() / length, q.y() / width);
    const double share = unit.norm() / (1 + lumps.At(std::atan2(q.y(), q.x())));
    if (share >= 1) return texel;
    texel.height = Dome(share, high);
    texel.color = Mix(crust * 0.75, crust * 1.25, Fractal(q, 4, seed)).cwiseMin(1);
    Over(texel, crust * 0.55, 0.7 * Ramp(0.80, 1.0, share));
    // blisters, and rings of flour that the basket leaves
    Over(texel, crust * 0.6, 0.5 * Ramp(0.25, 0.1, NearestSpot(q, 0.09, seed + 4).offset.norm() / 0.09));
    const double rings = 0.5 + 0.5 * std::cos(34 * share);
    Over(texel, {.96, .91, .82},
         flour * Ramp(0.45, 0.8, rings) * Ramp(0.3, 0.6, Fractal(q, 5, seed + 9)) * Ramp(1.0, 0.85, share));
    for (const auto& [a, b] : scores) {
      const double t = std::clamp((q - a).dot(b - a) / (b - a).squaredNorm(), 0.0, 1.0);
      const double open = score_width * std::sqrt(std::max(0.02, 4 * t * (1 - t)));
      const double off = SegmentDistance(q, a, b) + 0.03 * (Fractal(q, 9, seed + 13) - 0.5);
      Over(texel, crust * 0.42, Ramp(open + 0.035, open + 0.01, off));
      Over(texel, Mix(crumb, crumb * 0.85, Fractal(q, 14, seed + 17)), Ramp(open, open - 0.02, off));
      texel.height += 0.03 * Ramp(open + 0.08, open, off) - 0.05 * Ramp(open, 0, off);
    }
    return texel;
  };
}

namespace {

/// What lies between the two patties of a hamburger.
enum class Filling { kCheese, kBun, kLettuce };

/// The layers of a hamburger, from below; heights in the picture.
struct Layers {
  double heel_bottom, heel_top, lower_top, filling_top, patty_top, cheese_top, tomato_top, lettuce_top, crown_top;
};

Layers StackLayers(Rng& rng, Filling filling) {
  Layers y{};
  y.heel_bottom = -0.84;
  y.heel_top = y.heel_bottom + rng.Uniform(0.22, 0.28);
  y.lower_top = y.heel_top + rng.Uniform(0.20, 0.26);
  y.filling_top = y.lower_top + (filling == Filling::kBun ? 0.15 : 0.08);
  y.patty_top = y.filling_top + rng.Uniform(0.20, 0.26);
  y.cheese_top = y.patty_top + 0.06;
  y.tomato_top = y.cheese_top + (rng.Bernoulli(0.7) ? 0.10 : 0.0);
  y.lettuce_top = y.tomato_top + rng.Uniform(0.07, 0.11);
  y.crown_top = std::min(0.92, y.lettuce_top + rng.Uniform(0.44, 0.54));
  return y;
}

/// All that one hamburger was drawn with. Each part paints the colour at p and returns how wide the burger is there.
struct Hamburger {
  Filling filling;
  Layers y;
  double wide;
  Color bun, patty, cheese, lettuce;
  double corner, seeds;
  bool has_seeds;
  Waves frill;
  std::uint32_t seed;

  static Hamburger Make(Rng& rng);

  Texel At(const Vector2d& p) const {
    Texel texel;
    const double wave = frill.At(std::asin(std::clamp(p.x() / wide, -1.0, 1.0)));
    double radius = 0;
    if (p.y() > y.lettuce_top - 0.01)
      radius = Crown(p, texel);
    else if (p.y() > y.heel_top)
      radius = p.y() > y.filling_top ? Upper(p, wave, texel) : Lower(p, wave, texel);
    else if (p.y() > y.heel_bottom)
      radius = Heel(p, texel);
    texel.height = radius > std::abs(p.x()) ? std::sqrt(radius * radius - p.x() * p.x()) : 0;
    return texel;
  }

  /// The upper half of the bun: a dome that bulges over its edge.
  double Crown(const Vector2d& p, Texel& texel) const {
    const double t = (p.y() - y.lettuce_top) / (y.crown_top - y.lettuce_top);
    texel.color = Mix(bun, bun * 0.82, Fractal(p, 3, seed));
    Over(texel, {.95, .80, .50}, 0.8 * Ramp(0.16, 0.0, t));
    const Spot spot = NearestSpot({p.x(), p.y() * 1.5}, seeds, seed + 3);
    const Vector2d turned(spot.offset.x() + 0.5 * (spot.random - 0.5) * spot.offset.y(), spot.offset.y());
    const double grain = turned.cwiseQuotient(Vector2d(0.62, 1)).norm() / seeds;
    if (has_seeds && t > 0.25) {
      Over(texel, bun * 0.6, Ramp(0.34, 0.26, grain));
      Over(texel, {.98, .92, .74}, Ramp(0.27, 0.21, grain));
    }
    return t < 1 ? wide * std::pow(1 - std::pow(std::max(t, 0.0), 2.3), 0.5) : 0;
  }

  /// Lettuce, tomato, cheese, of which a corner hangs over the meat, and the upper patty.
  double Upper(const Vector2d& p, double wave, Texel& texel) const {
    if (p.y() > y.tomato_top + wave) {
      texel.color = Mix(lettuce, lettuce * 1.35, Ramp(0.3, 0.8, Fractal({p.x() * 3, p.y() * 1.2}, 4, seed + 5)));
      texel.color = texel.color.cwiseMin(1);
      return wide * 1.06 + 0.5 * wave;
    }
    if (p.y() > y.cheese_top) {
      texel.color = Mix(Color(.86, .16, .10), Color(.70, .08, .06), Fractal(p, 7, seed + 7));
      return wide * 0.96;
    }
    if (p.y() > y.patty_top - std::max(0.0, 0.17 - 0.45 * std::abs(p.x() - corner))) {
      texel.color = cheese;
      return wide * 0.99;
    }
    return Meat(p, y.filling_top, y.patty_top, texel);
  }

  /// What is between the patties, some of which hangs over the lower one, and that one.
  double Lower(const Vector2d& p, double wave, Texel& texel) const {
    const double slice = std::max(0.0, 0.15 - 0.45 * std::abs(p.x() + corner));
    const double hanging = filling == Filling::kCheese ? slice : filling == Filling::kLettuce ? 0.03 + 0.8 * wave : 0;
    if (p.y() <= y.lower_top - hanging) return Meat(p, y.heel_top, y.lower_top, texel);
    texel.color = filling == Filling::kBun ? Mix(bun, {.95, .80, .50}, 0.5 * Fractal(p, 6, seed + 15)) : cheese;
    if (filling == Filling::kLettuce)
      texel.color = Mix(lettuce, lettuce * 1.35, Fractal({p.x() * 3, p.y() * 1.2}, 4, seed + 6)).cwiseMin(1);
    return wide * (filling == Filling::kLettuce ? 1.04 + 0.5 * wave : 0.98);
  }

  double Meat(const Vector2d& p, double from, double to, Texel& texel) const {
    const double t = (p.y() - from) / (to - from);
    texel.color = Mix(patty * 0.7, patty * 1.35, Fractal(p, 9, seed + 9));
    return wide * (0.93 + 0.07 * std::sqrt(std::max(0.0, 1 - (2 * t - 1) * (2 * t - 1))));
  }

  /// The lower half of the bun.
  double Heel(const Vector2d& p, Texel& texel) const {
    const double t = (p.y() - y.heel_bottom) / (y.heel_top - y.heel_bottom);
    texel.color = Mix(bun, bun * 0.85, Fractal(p, 3, seed + 11));
    Over(texel, {.95, .80, .50}, 0.8 * Ramp(0.7, 1.0, t));
    return wide * (0.86 + 0.10 * std::sqrt(std::min(1.0, t * 1.5)));
  }
};

Hamburger Hamburger::Make(Rng& rng) {
  Hamburger burger;
  burger.filling = static_cast<Filling>(rng.Below(3));
  burger.y = StackLayers(rng, burger.filling);
  burger.wide = rng.Uniform(0.64, 0.70);
  burger.bun = Pick(rng, {{.84, .56, .22}, {.74, .44, .16}, {.90, .66, .30}, {.62, .34, .14}}, 0.02);
  burger.patty = Pick(rng, {{.36, .20, .11}, {.28, .15, .09}, {.46, .27, .15}}, 0.02);
  burger.cheese = Pick(rng, {{.98, .76, .16}, {.96, .62, .12}, {.98, .90, .55}}, 0.02);
  burger.lettuce = Pick(rng, {{.44, .70, .18}, {.30, .58, .14}, {.58, .78, .30}}, 0.02);
  burger.corner = rng.Uniform(-0.4, 0.4);
  burger.seeds = rng.Uniform(0.12, 0.17);
  burger.has_seeds = rng.Bernoulli(0.8);
  burger.frill = Waves::Make(rng, 0.035, 9);
  burger.seed = NoiseSeed(rng);
  return burger;
}

}  // namespace

Drawing DrawHamburger(Rng& rng) {
  return [burger = Hamburger::Make(rng)](const Vector2d& p) { return burger.At(p); };
}

namespace {

enum class Decoration { kPlain, kBand, kStripes, kDots, kHeart, kZigzag };

/// How much of the decoration's colour there is at (u, v): u around from the middle (rad), v 0..1 from below.
double Decorate(Decoration decoration, double u, double v) {
  switch (decoration) {
    case Decoration::kPlain:
      return 0;
    case Decoration::kBand:
      return Ramp(0.20, 0.19, std::abs(v - 0.5));
    case Decoration::kStripes:
      return Ramp(-0.08, 0.08, std::sin(v * 26));
    case Decoration::kDots: {
      const double row = std::floor(v * 5), x = u * 2.4 + 0.5 * row;
      return Ramp(0.30, 0.26, std::hypot(x - std::floor(x) - 0.5, v * 5 - row - 0.5));
    }
    case Decoration::kHeart: {
      const double x = u / 0.55, y = (v - 0.47) / 0.24;
      const double f = x * x + std::pow(y - 0.65 * std::sqrt(std::abs(x)), 2);
      return Ramp(1.05, 0.95, f);
    }
    case Decoration::kZigzag: {
      const double saw = std::abs(2 * (u * 1.6 - std::floor(u * 1.6)) - 1);
      return Ramp(0.09, 0.08, std::abs(v - 0.42 - 0.18 * saw));
    }
  }
  return 0;
}

/// What is drawn of a mug; lengths in halves of the picture.
struct Mug {
  double radius, bottom, top;
  double taper;            ///< narrower below by this share
  double opening;          ///< half the height of the rim's ellipse
  double middle;           ///< x of its axis
  double grip, bar, tall;  ///< the handle: radius, half its thickness, how much higher than wide
  Color glaze, second, drink;
  Decoration decoration;

  double Side(double v) const { return radius * (1 - taper * (1 - std::clamp(v, 0.0, 1.0))); }
  void PaintHandle(const Vector2d& q, double side, Texel& texel) const;
  void PaintRim(const Vector2d& q, double sagitta, Texel& texel) const;
};

/// A bent bar from the side. `q`: from the axis.
void Mug::PaintHandle(const Vector2d& q, double side, Texel& texel) const {
  const Vector2d on_handle(q.x() - 0.96 * side, (q.y() - 0.02) / tall);
  const double off = std::abs(on_handle.norm() - grip) / bar;
  if (off >= 1 || q.x() <= 0.8 * side) return;
  texel.height = Dome(off, bar);
  texel.color = glaze * (1 - 0.12 * off);
}

/// Seen a little from above: the rim, the inside, the drink. `sagitta`: half the rim's ellipse there.
void Mug::PaintRim(const Vector2d& q, double sagitta, Texel& texel) const {
  const double ring = Vector2d(q.x() / radius, (q.y() - top) / opening).norm();
  if (ring >= 1) return;
  texel.color = Mix(glaze, {1, 1, 1}, 0.35);
  Over(texel, Mix(glaze, {.9, .88, .84}, 0.3) * 0.72, Ramp(0.90, 0.86, ring));
  const double level = Vector2d(q.x() / (0.84 * radius), (q.y() - top + 0.025) / (0.70 * opening)).norm();
  Over(texel, drink, Ramp(1.0, 0.95, level));
  texel.height *= std::lerp(1.0, 0.30, (q.y() - top + sagitta) / std::max(2 * sagitta, 1e-6));
}

Mug DrawShape(Rng& rng) {
  Mug mug{};
  mug.radius = rng.Uniform(0.40, 0.46);
  mug.bottom = -rng.Uniform(0.74, 0.82);
  mug.top = -mug.bottom - 0.06;
  mug.taper = rng.Uniform(0.0, 0.12);
  mug.opening = rng.Uniform(0.09, 0.13);
  mug.middle = -0.16;
  mug.grip = rng.Uniform(0.20, 0.24);
  mug.bar = rng.Uniform(0.075, 0.090);
  mug.tall = rng.Uniform(1.6, 1.9);
  return mug;
}

}  // namespace

Drawing DrawMug(Rng& rng) {
  Mug mug = DrawShape(rng);
  mug.glaze = Pick(rng, {{.93, .92, .88},
                         {.20, .40, .62},
                         {.75, .22, .20},
                         {.95, .78, .26},
                         {.30, .52, .42},
                         {.22, .22, .25},
                         {.62, .76, .84}});
  mug.second = mug.glaze.sum() > 1.9 ? Pick(rng, {{.78, .15, .18}, {.15, .35, .60}, {.12, .45, .35}, {.2, .2, .22}})
                                     : Pick(rng, {{.96, .94, .88}, {.98, .82, .40}});
  mug.drink = Pick(rng, {{.24, .13, .07}, {.50, .32, .18}, {.60, .35, .10}}, 0.02);
  mug.decoration = static_cast<Decoration>(rng.Below(6));

  return [=](const Vector2d& p) {
    Texel texel;
    const double v = (p.y() - mug.bottom) / (mug.top - mug.bottom), side = mug.Side(v);
    const Vector2d q(p.x() - mug.middle, p.y());
    const double sagitta = mug.opening * std::sqrt(std::max(0.0, 1 - q.x() * q.x() / (mug.radius * mug.radius)));
    mug.PaintHandle(q, side, texel);
    if (v <= 0 || std::abs(q.x()) >= side || p.y() >= mug.top + sagitta) return texel;
    texel.height = std::sqrt(side * side - q.x() * q.x()) * (0.94 + 0.06 * Ramp(0.0, 0.05, v));
    texel.color = mug.glaze;
    Over(texel, mug.second, Decorate(mug.decoration, std::asin(q.x() / side), (v - 0.02) / 0.86));
    Over(texel, mug.glaze * 0.75, Ramp(0.04, 0.02, v));
    mug.PaintRim(q, sagitta, texel);
    return texel;
  };
}

}  // namespace etude::synthesis
