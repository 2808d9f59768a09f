// SPDX-License-Identifier: Apache-2.0
// Pictures drawn by formula, so that the scene needs no files: labels that read from a few pixels.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "worker/assets/object_parts.h"

namespace etude::assets {
namespace {

using Eigen::Vector2d;
using std::numbers::pi;

const Color kWhite(0.97, 0.97, 0.97), kSilver(0.80, 0.81, 0.83);
constexpr int kCanWidth = 512, kCanRows = 256;
// the label is on the can twice, so that it faces +y (towards the camera) and -y
constexpr double kLabelCentres[] = {0.25 * kCanWidth, 0.75 * kCanWidth};

/// Lid and base of a can: rows of silver with a darker ring (see CanMesh for the rows).
void PaintMetal(Canvas& canvas) {
  const auto band = [&](double from, double to, const Color& color) {
    canvas.Paint(Rectangle({-1, from * kCanRows}, {kCanWidth + 1, to * kCanRows}), color);
  };
  band(-.1, .105, kSilver);
  band(.03, .05, kSilver * .75);
  band(.945, 1.1, kSilver);
}

/// The stripe between two curves y(x), as a shape.
template <class Low, class High>
Shape Between(Low low, High high) {
  return [=](const Vector2d& p) { return std::max(low(p.x()) - p.y(), p.y() - high(p.x())); };
}

}  // namespace

Canvas CokeTexture() {
  Canvas canvas(kCanWidth, kCanRows, {0.80, 0.05, 0.08});
  const double period = kCanWidth / 2.0;
  const auto wave = [=](double x) { return 178 + 20 * std::sin(2 * pi * (x - 20) / period); };
  canvas.Paint(Between(wave, [=](double x) { return wave(x) + 17 + 7 * std::cos(2 * pi * (x - 40) / period); }),
               kWhite);
  for (const double centre : kLabelCentres) {
    const double size = 62, width = Canvas::TextWidth("Coke", size) + 0.2 * size;
    canvas.Write("Coke", {centre - width / 2, 132}, size, 11, 0.22, kWhite);
  }
  PaintMetal(canvas);
  return canvas;
}

Canvas PepsiTexture() {
  const Color blue(0.02, 0.20, 0.62);
  Canvas canvas(kCanWidth, kCanRows, blue);
  for (const double centre : kLabelCentres) {
    const Vector2d middle(centre, 108);
    const double radius = 56;
    const Shape disc = Disc(middle, radius);
    const auto upper = [=](double x) { return middle.y() - 12 - 12 * std::sin((x - centre) / radius * 2.4); };
    const auto lower = [=](double x) { return middle.y() + 16 - 12 * std::sin((x - centre) / radius * 2.4); };
    const auto inside = [&](double from, auto curve) {
      return [=](const Vector2d& p) { return std::max(disc(p), from * (p.y() - curve(p.x()))); };
    };
    canvas.Paint(Disc(middle, radius + 7), kWhite);
    canvas.Paint(inside(1, upper), {0.88, 0.08, 0.14});
    canvas.Paint(inside(-1, lower), {0.05, 0.30, 0.78});
    const double size = 36, width = Canvas::TextWidth("PEPSI", size);
    canvas.Write("PEPSI", {centre - width / 2, 224}, size, 7, 0.12, kWhite);
  }
  PaintMetal(canvas);
  return canvas;
}

Canvas MilkTexture() {
  const int w = 128, h = 424;
  const Color white(0.985, 0.985, 0.97), blue(0.10, 0.36, 0.78);
  Canvas canvas(w, h, white);
  canvas.Paint(Rectangle({-1, .09 * h}, {w + 1, .13 * h}), blue);  // a stripe on the roof
  const auto hill = [=](double x) { return .66 * h + 22 * std::sin(2 * pi * x / w + .5); };
  canvas.Paint(Between(hill, [=](double) { return h + 1.0; }), {0.36, 0.68, 0.93});
  canvas.Paint(Between([=](double x) { return hill(w - x) + 34; }, [=](double) { return h + 1.0; }), blue);
  const double size = 43, width = Canvas::TextWidth("MILK", size);
  canvas.Write("MILK", {(w - width) / 2 + 2, .50 * h}, size, 9, 0, blue);
  return canvas;
}

Canvas BreadTexture() {
  const int n = 128;
  Canvas canvas(n, n, {0.72, 0.45, 0.20});
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const double u = (x + .5) / n, v = (y + .5) / n;
      const double grain = .6 * Noise(u * 14, v * 14, 11) + .4 * Noise(u * 40, v * 40, 12) - .5;
      // darker crust on top and along the edges, lighter towards the middle
      const double rim = std::max({std::abs(2 * u - 1), .8 * std::abs(2 * v - 1)});
      const double dark = std::clamp((rim - .45) / .55, 0.0, 1.0) * .45 + std::max(0.0, .25 - v) * .8;
      const Color crumb(0.87, 0.64, 0.34), crust(0.56, 0.31, 0.12);
      canvas.at(x, y) = (crumb + dark * (crust - crumb)) * (1 + .16 * grain);
    }
  for (const double x : {.30, .55, .80})  // the baker's cuts
    canvas.Paint(Brush({{{(x - .10) * n, .06 * n}, {(x + .02) * n, .26 * n}}}, 5), {0.93, 0.76, 0.48});
  return canvas;
}

Canvas BottleLabelTexture() {
  Canvas canvas(256, 64, {0.94, 0.93, 0.80});
  for (const double y : {5.0, 59.0}) canvas.Paint(Rectangle({-1, y - 2}, {257, y + 2}), {0.75, 0.62, 0.20});
  for (const double x : {64.0, 192.0}) {  // a leaf
    canvas.Paint(Disc({x - 6, 34}, 15), {0.16, 0.50, 0.14});
    canvas.Paint(Disc({x + 9, 28}, 11), {0.30, 0.66, 0.18});
  }
  return canvas;
}

Canvas BallTexture(const Color& colour) {
  const int w = 512, h = 256;
  const Color black(0.07, 0.06, 0.06);
  Canvas canvas(w, h, colour);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      const double around = 2 * pi * (x + .5) / w, down = pi * (y + .5) / h;
      const Eigen::Vector3d p(std::sin(down) * std::cos(around), std::sin(down) * std::sin(around), std::cos(down));
      // two great circles, and a curve to each side that bulges away from them; distances in radii
      const double side = std::abs(p.x()) - (0.42 + 0.30 * p.z() * p.z());
      const double seam = std::min({std::abs(p.z()), std::abs(p.x()), std::abs(side)});
      const double pebbles = Noise(x * 0.9 * std::sin(down), y * 0.9, 31) - .5;
      const double dark = std::clamp((0.050 - seam) / 0.012, 0.0, 1.0);
      canvas.at(x, y) = colour * (1 + .10 * pebbles) + dark * (black - colour * (1 + .10 * pebbles));
    }
  return canvas;
}

Canvas WoodTexture() {
  const int n = 512, planks = 8;
  Canvas canvas(n, n, {0.66, 0.47, 0.31});
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const double u = (x + .5) / n, v = (y + .5) / n;
      const int plank = std::min(planks - 1, static_cast<int>(u * planks));
      const double across = u * planks - plank, shift = 7.3 * plank;
      const double warp = Noise(across * 2 + shift, v * 5 + shift, 21);
      const double rings = .5 + .5 * std::sin(2 * pi * (across * 3.2 + 1.7 * warp + shift));
      const double fibre = Noise(u * 190, v * 16 + shift, 22);
      const double tone = .94 + .12 * Noise(plank * 3.7, .5, 23);
      const double seam = std::min({across, 1 - across}) * n / planks < 1.2 ? .62 : 1.0;
      const double light = tone * (.90 + .10 * rings + .10 * (fibre - .5)) * seam;
      canvas.at(x, y) = Color(0.68, 0.48, 0.31) * light;
    }
  return canvas;
}

}  // namespace etude::assets
