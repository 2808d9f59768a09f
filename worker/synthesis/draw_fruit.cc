// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>

#include "worker/synthesis/drawings.h"

namespace etude::synthesis {
namespace {

using Eigen::Vector2d;
using std::numbers::pi;

double Bump(double x, double width) { return std::exp(-(x / width) * (x / width)); }

/// Height of a body of revolution about a line in the picture, `off` from that line where its radius is `radius`.
double Round(double off, double radius) { return radius > std::abs(off) ? std::sqrt(radius * radius - off * off) : 0; }

/// Half the width of a pear at height y: two circles, joined smoothly.
struct PearOutline {
  double belly, neck, belly_y, neck_y;

  double Radius(double y) const {
    const double low = belly * belly - (y - belly_y) * (y - belly_y);
    const double high = neck * neck - (y - neck_y) * (y - neck_y);
    // the flank between the two middles is eased from one radius to the other
    const double t = Ramp(belly_y + 0.25 * belly, neck_y + 0.35 * neck, y);
    const double flank = std::lerp(belly * 0.98, neck, t);
    if (y > belly_y + 0.25 * belly && y < neck_y + 0.35 * neck) return flank;
    return y <= belly_y + 0.25 * belly ? std::sqrt(std::max(low, 0.0)) : std::sqrt(std::max(high, 0.0));
  }
};

}  // namespace

Drawing DrawApple(Rng& rng) {
  const double wide = rng.Uniform(0.80, 0.90), notch = rng.Uniform(0.14, 0.24), foot = rng.Uniform(0.05, 0.10);
  const double taper = rng.Uniform(0.02, 0.10), lean = rng.Uniform(-0.12, 0.12), blush_side = rng.Uniform(-1, 1);
  const Color skin = Pick(rng, {{.75, .08, .09}, {.55, .04, .08}, {.52, .70, .16}, {.90, .75, .22}, {.85, .25, .18}});
  const Color blush = Pick(rng, {{.80, .12, .08}, {.92, .60, .20}, {.60, .05, .10}, {.75, .78, .25}});
  const double blush_amount = rng.Uniform(0.2, 0.9);
  const std::uint32_t seed = NoiseSeed(rng);
  const Vector2d dip(0.02 * lean, 0.70 * (1 - notch) - 0.04);
  const Stalk stalk{dip - Vector2d(0, 0.06), dip + Vector2d(lean, rng.Uniform(0.24, 0.34)), rng.Uniform(0.030, 0.045)};
  const bool has_leaf = rng.Bernoulli(0.6);
  const double side = rng.Bernoulli(0.5) ? 0.5 : pi - 0.5;
  const Leaf leaf{dip + Vector2d(0.5 * lean, 0.14), side + rng.Uniform(-0.2, 0.2), rng.Uniform(0.35, 0.5),
                  rng.Uniform(0.10, 0.15)};

  return [=](const Vector2d& p) {
    Texel texel;
    if (has_leaf) leaf.Paint(p, 0.07, texel);
    const Vector2d q(p.x() / wide, p.y() + 0.08);
    const double angle = std::atan2(q.x(), q.y());
    const double outline =
        0.78 * (1 - notch * Bump(angle, 0.42) - foot * Bump(pi - std::abs(angle), 0.35) + taper * std::cos(angle));
    const double share = q.norm() / outline;
    if (share < 1) {
      texel.height = Dome(share, 0.74);
      const double around = q.x() / (std::sqrt(std::max(0.05, 0.7 - q.y() * q.y())));
      const double streaks = Fractal({around * 14, q.y() * 1.5}, 1, seed);
      const double patches = Fractal(q, 1.6, seed + 9) + 0.35 * blush_side * around;
      texel.color = Mix(skin, blush, blush_amount * Ramp(0.35, 0.75, 0.5 * streaks + 0.5 * patches));
      // pale pores, and the yellow-green dip around the stalk
      const Spot pore = NearestSpot(q, 0.095, seed + 20);
      Over(texel, {.93, .85, .62}, 0.7 * Ramp(0.014, 0.006, pore.offset.norm()));
      const double in_dip = ((q - Vector2d(0, dip.y() + 0.10)).cwiseQuotient(Vector2d(0.30, 0.16))).norm();
      Over(texel, {.45, .42, .14}, 0.75 * Ramp(1, 0.3, in_dip));
    }
    stalk.Paint(p, texel);
    return texel;
  };
}

Drawing DrawOrange(Rng& rng) {
  const double wide = rng.Uniform(0.91, 0.97), lump = rng.Uniform(0, 0.02), turn = rng.Uniform(0, 2 * pi);
  const Color skin = Pick(rng, {{.96, .52, .06}, {.93, .42, .05}, {.98, .62, .12}, {.88, .36, .06}}, 0.03);
  const double pores = rng.Uniform(0.045, 0.065);
  const bool has_leaf = rng.Bernoulli(0.5);
  const double navel_y = rng.Uniform(0.35, 0.5);  // a statement each: arguments have no order
  const Vector2d navel(rng.Uniform(-0.25, 0.25), navel_y);
  const double green = rng.Uniform(0, 0.35);
  const std::uint32_t seed = NoiseSeed(rng);
  const Leaf leaf{navel, rng.Uniform(0.2, 2.8), rng.Uniform(0.4, 0.5), rng.Uniform(0.12, 0.17), {.16, .42, .12}};

  return [=](const Vector2d& p) {
    Texel texel;
    const Vector2d q(p.x() / wide, p.y());
    const double outline = 0.80 * (1 + lump * std::cos(3 * std::atan2(q.y(), q.x()) + turn));
    const double share = q.norm() / outline;
    if (share < 1) {
      const Spot pore = NearestSpot(q, pores, seed);
      const double pit = Ramp(0.55 * pores, 0.1 * pores, pore.offset.norm());
      texel.height = Dome(share, 0.80) * (1 - 0.006 * pit);
      texel.color = Mix(skin, skin * 1.12 + Color(0.02, 0.03, 0), Fractal(q, 2.5, seed + 5)).cwiseMin(1);
      Over(texel, skin * 0.72, 0.75 * pit);
      Over(texel, {.55, .60, .12}, green * Ramp(0.55, 0.1, (q - navel).norm()));
      // the green star that the stalk leaves
      const Vector2d star = q - navel;
      const double rays = 0.075 * (1 + 0.45 * std::cos(5 * std::atan2(star.y(), star.x())));
      Over(texel, {.30, .38, .12}, Ramp(rays, 0.7 * rays, star.norm()));
      Over(texel, {.50, .42, .20}, Ramp(0.03, 0.02, star.norm()));
    }
    if (has_leaf) leaf.Paint(p, texel.height + 0.03, texel);
    return texel;
  };
}

Drawing DrawStrawberry(Rng& rng) {
  const double wide = rng.Uniform(0.60, 0.70), blunt = rng.Uniform(0.45, 0.62), bend = rng.Uniform(-0.10, 0.10);
  const Color skin = Pick(rng, {{.84, .07, .10}, {.72, .04, .08}, {.90, .18, .14}}, 0.03);
  const double spacing = rng.Uniform(0.13, 0.18), pale = rng.Uniform(0, 0.6);
  const int leaves = 5 + static_cast<int>(rng.Below(3));
  const double lift = rng.Uniform(0.2, 0.5), leaf_length = rng.Uniform(0.36, 0.46);
  const std::uint32_t seed = NoiseSeed(rng);
  const Color green = Pick(rng, {{.24, .52, .14}, {.34, .60, .18}, {.16, .42, .12}}, 0.03);
  const Vector2d crown(0, 0.50);

  return [=](const Vector2d& upright) {
    Texel texel;
    const Vector2d p(upright.x(), -upright.y());  // it stands on its leaves
    // y from the tip (0) to the shoulders (1)
    const double y = (p.y() + 0.86) / 1.46;
    const Vector2d q(p.x() - bend * (1 - y) * (1 - y), p.y());
    if (y > 0 && y < 1) {
      const double radius = wide * std::pow(y, blunt) * std::sqrt(std::max(0.0, 1 - std::pow(y, 7))) * 1.02;
      // flatter in front than a circle, so that it does not roll when it lies
      texel.height = 0.84 * radius * std::sqrt(std::max(0.0, 1 - std::pow(std::abs(q.x()) / radius, 2.8)));
      if (texel.height > 0) {
        texel.color = Mix(skin, skin * 0.85, Fractal(q, 3, seed + 3));
        Over(texel, {.96, .80, .66}, pale * Ramp(0.78, 1.0, y));
        // seeds in dimples, drawn to the tip
        const Spot spot = NearestSpot({q.x() / 0.85, q.y() / 1.15}, spacing, seed);
        const double ring = Vector2d(spot.offset.x(), 0.62 * spot.offset.y()).norm() / spacing;
        Over(texel, skin * 0.55, 0.8 * Ramp(0.27, 0.15, ring));
        Over(texel, {.96, .80, .32}, Ramp(0.16, 0.11, ring));
        texel.height *= 1 - 0.012 * Ramp(0.3, 0.1, ring);
      }
    }
    for (int i = 0; i < leaves; ++i) {
      const double fan = pi - lift + (pi + 2 * lift) * (i + 0.5) / leaves;
      const Leaf leaf{crown, fan, leaf_length, 0.11, green};
      leaf.Paint(p, std::max(texel.height, 0.0) + 0.05, texel);
    }
    return texel;
  };
}

Drawing DrawLemon(Rng& rng) {
  const double thick = rng.Uniform(0.52, 0.60), length = rng.Uniform(0.70, 0.76), tip = rng.Uniform(0.17, 0.25);
  const double turn = rng.Uniform(-0.12, 0.12);
  const Color skin = Pick(rng, {{.97, .86, .16}, {.95, .80, .12}, {.99, .92, .34}, {.86, .84, .18}}, 0.03);
  const double pores = rng.Uniform(0.045, 0.065), green = rng.Uniform(0, 0.6);
  const std::uint32_t seed = NoiseSeed(rng);
  const bool has_leaf = rng.Bernoulli(0.35);

  return [=](const Vector2d& upright) {
    Texel texel;
    const Vector2d p(upright.y(), -upright.x());  // it stands on its blunt end
    const Vector2d q(std::cos(turn) * p.x() + std::sin(turn) * p.y(), std::cos(turn) * p.y() - std::sin(turn) * p.x());
    const double u = q.x() / length;
    // an ellipse, fuller below, with a nipple at its upper end
    const double bulge = u > 0 ? u * u : std::pow(-u, 2.6);
    double radius = std::abs(u) < 1 ? thick * std::pow(1 - bulge, 0.62) : 0;
    if (u > 0.6 && u < 1 + tip) radius = std::hypot(radius, 0.17 * std::sqrt(1 - std::pow(u / (1 + tip), 8)));
    texel.height = Round(q.y(), radius);
    if (texel.height > 0) {
      const Spot pore = NearestSpot(q, pores, seed);
      const double pit = Ramp(0.5 * pores, 0.1 * pores, pore.offset.norm());
      texel.color = Mix(skin, skin * 0.93, Fractal(q, 3, seed + 5));
      Over(texel, {.80, .66, .08}, 0.6 * pit);
      Over(texel, {.52, .66, .14}, green * Ramp(0.72, 1.05, std::abs(u)));
      Over(texel, {.42, .32, .10}, Ramp(1 + tip - 0.06, 1 + tip - 0.02, u));
      texel.height *= 1 - 0.006 * pit;
    }
    if (has_leaf)
      Leaf{length * Vector2d(std::cos(turn), std::sin(turn)), -2.0, 0.42, 0.13, {.20, .45, .12}}.Paint(
          p, texel.height + 0.03, texel);
    return texel;
  };
}

Drawing DrawPear(Rng& rng) {
  const PearOutline outline{rng.Uniform(0.51, 0.57), rng.Uniform(0.32, 0.38), rng.Uniform(-0.36, -0.28),
                            rng.Uniform(0.30, 0.40)};
  const double lean = rng.Uniform(-0.08, 0.08);
  const Color skin = Pick(rng, {{.74, .76, .22}, {.55, .66, .18}, {.86, .74, .28}, {.66, .45, .20}, {.64, .16, .14}});
  const Color blush = Pick(rng, {{.84, .42, .20}, {.70, .20, .14}, {.60, .70, .22}, {.76, .58, .24}});
  const double blush_amount = rng.Uniform(0.1, 0.8), side = rng.Uniform(-1, 1);
  const std::uint32_t seed = NoiseSeed(rng);
  const double top = outline.neck_y + outline.neck;
  const Stalk stalk{{lean, top - 0.08}, {lean + rng.Uniform(-0.14, 0.14), top + rng.Uniform(0.14, 0.2)}, 0.036};
  const bool has_leaf = rng.Bernoulli(0.35);
  const Leaf leaf{{lean, top + 0.02}, rng.Bernoulli(0.5) ? 0.3 : 2.8, 0.4, 0.12};

  return [=](const Vector2d& p) {
    Texel texel;
    if (has_leaf) leaf.Paint(p, 0.06, texel);
    const double bend = lean * Ramp(-0.2, 0.7, p.y());
    const double radius = outline.Radius(p.y()), x = p.x() - bend;
    const double height = Round(x, radius);
    if (height > 0) {
      texel.height = height;
      const double around = x / radius;
      const double patches = Fractal(p, 2, seed) + 0.35 * side * around;
      texel.color = Mix(skin, blush, blush_amount * Ramp(0.4, 0.8, patches));
      const Spot dot = NearestSpot({p.x() * 1.0, p.y()}, 0.06, seed + 7);
      Over(texel, {.46, .34, .14}, 0.65 * Ramp(0.015, 0.006, dot.offset.norm()));
      // russet at both ends
      const double ends = std::max(Ramp(top - 0.22, top, p.y()), Ramp(-0.72, -0.92, p.y()));
      Over(texel, {.52, .38, .16}, 0.7 * ends * Fractal(p, 6, seed + 11) * 1.5);
    }
    stalk.Paint(p, texel);
    return texel;
  };
}

namespace {

// The stone of an avocado, or the hollow that it left.
struct Stone {
  double radius, y;
  bool hollow;
  Color pit, flesh;
  std::uint32_t seed;

  void Paint(Texel& texel, const Vector2d& q) const {
    const Vector2d to_stone = q - Vector2d(0, y);
    const double from_stone = to_stone.norm() / radius;
    if (hollow) {
      Over(texel, Mix(flesh, {.62, .50, .20}, 0.6), Ramp(1.04, 0.96, from_stone));
      Over(texel, Mix(flesh, {.70, .62, .28}, 0.4), Ramp(0.8, 0.3, from_stone));
      texel.height -= 0.3 * Dome(from_stone, radius);
      return;
    }
    Over(texel, pit * 0.6, Ramp(1.06, 0.98, from_stone));
    Over(texel, Mix(pit, pit * 1.3, Fractal(q, 7, seed + 5)), Ramp(0.99, 0.93, from_stone));
    const double shine = (to_stone + radius * Vector2d(0.35, -0.35)).norm() / radius;
    Over(texel, (pit * 1.6 + Color(.15, .15, .15)).cwiseMin(1), 0.7 * Ramp(0.25, 0.05, shine));
    texel.height += 0.25 * Dome(from_stone, radius);
  }
};

}  // namespace

Drawing DrawAvocado(Rng& rng) {
  const double wide = rng.Uniform(0.54, 0.64), waist = rng.Uniform(0.05, 0.28), turn = rng.Uniform(-0.15, 0.15);
  const double stone = rng.Uniform(0.24, 0.31), stone_y = rng.Uniform(-0.30, -0.22), thick = rng.Uniform(0.46, 0.54);
  const Color skin = Pick(rng, {{.16, .24, .08}, {.12, .12, .07}, {.22, .34, .10}}, 0.02);
  const Color flesh = Pick(rng, {{.88, .88, .48}, {.80, .84, .38}, {.93, .90, .60}}, 0.02);
  const Color rim = Pick(rng, {{.52, .68, .20}, {.42, .60, .16}}, 0.03);
  const Color pit = Pick(rng, {{.50, .28, .12}, {.62, .40, .20}, {.38, .20, .10}}, 0.03);
  const bool hollow = rng.Bernoulli(0.25);
  const std::uint32_t seed = NoiseSeed(rng);
  const Stone in_the_middle{stone, stone_y, hollow, pit, flesh, seed};

  return [=](const Vector2d& p) {
    Texel texel;
    const Vector2d q(std::cos(turn) * p.x() + std::sin(turn) * p.y(), std::cos(turn) * p.y() - std::sin(turn) * p.x());
    const double y = q.y() / 0.9;
    if (std::abs(y) >= 1) return texel;
    // an egg with a waist above its middle
    const double radius = wide * std::sqrt(1 - y * y) * (1 - 0.30 * y) * (1 - waist * Bump(y - 0.42, 0.35));
    if (std::abs(q.x()) >= radius) return texel;
    // how far in from the outline, whichever way
    const double inwards = 1 - std::hypot(q.x() / radius * std::sqrt(1 - y * y), y);
    texel.height = Dome(std::clamp(1 - inwards, 0.0, 1.0), thick) + 0.02;
    const double ragged = inwards + 0.02 * (Fractal(q, 6, seed) - 0.5);
    texel.color = Mix(skin, rim, Ramp(0.045, 0.065, ragged));
    Over(texel, flesh, Ramp(0.08, 0.30, ragged));
    Over(texel, flesh * 0.93, 0.5 * Fractal(q, 8, seed + 3));
    in_the_middle.Paint(texel, q);
    return texel;
  };
}

}  // namespace etude::synthesis
