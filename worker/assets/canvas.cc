// SPDX-License-Identifier: Apache-2.0
#include "worker/assets/canvas.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <numbers>
#include <string>

#include "services/core/check.h"

namespace etude::assets {
namespace {

using Eigen::Vector2d;
using std::numbers::pi;

struct Glyph {
  double advance = 0;           ///< in heights of a capital
  std::vector<Stroke> strokes;  ///< x right, y up from the base line
};

/// Our own letters, drawn as strokes in a box one capital high.
const std::map<char, Glyph>& Glyphs() {
  const auto arc = [](double x, double y, double rx, double ry, double a, double b) {
    return Arc({x, y}, {rx, ry}, a, b);
  };
  static const std::map<char, Glyph> glyphs{
      {'C', {.85, {arc(.42, .5, .40, .5, .28 * pi, 1.75 * pi)}}},
      {'o', {.60, {arc(.27, .3, .24, .3, 0, 2 * pi)}}},
      {'k', {.60, {{{.06, 0}, {.06, 1}}, {{.48, .58}, {.08, .26}}, {{.18, .33}, {.52, 0}}}}},
      {'e', {.60, {{{.05, .32}, {.48, .32}}, arc(.27, .3, .23, .3, 0, 1.8 * pi)}}},
      {'P',
       {.74,
        {{{.08, 0}, {.08, 1}},
         {{.08, 1}, {.36, 1}},
         {{.08, .45}, {.36, .45}},
         arc(.36, .725, .26, .275, -.5 * pi, .5 * pi)}}},
      {'E', {.68, {{{.08, 0}, {.08, 1}}, {{.08, 1}, {.56, 1}}, {{.08, .5}, {.48, .5}}, {{.08, 0}, {.56, 0}}}}},
      {'S', {.70, {arc(.33, .745, .25, .255, .15 * pi, 1.5 * pi), arc(.33, .245, .25, .245, -.85 * pi, .5 * pi)}}},
      {'I', {.34, {{{.12, 0}, {.12, 1}}}}},
      {'M', {.95, {{{.08, 0}, {.08, 1}}, {{.08, 1}, {.43, .3}}, {{.43, .3}, {.78, 1}}, {{.78, 1}, {.78, 0}}}}},
      {'L', {.62, {{{.08, 0}, {.08, 1}}, {{.08, 0}, {.52, 0}}}}},
      {'K', {.72, {{{.08, 0}, {.08, 1}}, {{.58, 1}, {.1, .42}}, {{.25, .58}, {.6, 0}}}}},
  };
  return glyphs;
}

double Hash(std::int64_t x, std::int64_t y, std::uint32_t seed) {
  std::uint64_t h = seed * 0x9E3779B97F4A7C15ull + static_cast<std::uint64_t>(x) * 0xBF58476D1CE4E5B9ull +
                    static_cast<std::uint64_t>(y) * 0x94D049BB133111EBull;
  h ^= h >> 31;
  h *= 0xD6E8FEB86659FD93ull;
  h ^= h >> 32;
  return static_cast<double>(h >> 11) * 0x1p-53;
}

}  // namespace

double SegmentDistance(const Vector2d& p, const Vector2d& a, const Vector2d& b) {
  const Vector2d along = b - a;
  const double length2 = along.squaredNorm();
  const double t = length2 > 0 ? std::clamp((p - a).dot(along) / length2, 0.0, 1.0) : 0.0;
  return (p - a - t * along).norm();
}

Shape Disc(const Vector2d& centre, double radius) {
  return [=](const Vector2d& p) { return (p - centre).norm() - radius; };
}

Shape Rectangle(const Vector2d& low, const Vector2d& high) {
  return [=](const Vector2d& p) { return (low - p).cwiseMax(p - high).maxCoeff(); };
}

Shape Brush(std::vector<Stroke> strokes, double width) {
  return [strokes = std::move(strokes), width](const Vector2d& p) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const Stroke& stroke : strokes)
      for (std::size_t i = 0; i + 1 < stroke.size(); ++i)
        nearest = std::min(nearest, SegmentDistance(p, stroke[i], stroke[i + 1]));
    return nearest - width / 2;
  };
}

Stroke Arc(const Vector2d& centre, const Vector2d& radii, double a, double b) {
  constexpr int kPieces = 14;
  Stroke stroke;
  for (int i = 0; i <= kPieces; ++i) {
    const double angle = a + (b - a) * i / kPieces;
    stroke.push_back(centre + Vector2d(radii.x() * std::cos(angle), radii.y() * std::sin(angle)));
  }
  return stroke;
}

Canvas::Canvas(int width, int height, const Color& background)
    : width_(width), height_(height), pixels_(static_cast<std::size_t>(width) * height, background) {}

void Canvas::Paint(const Shape& shape, const Color& color) {
  for (int y = 0; y < height_; ++y)
    for (int x = 0; x < width_; ++x) {
      const double coverage = std::clamp(0.5 - shape({x + 0.5, y + 0.5}), 0.0, 1.0);
      if (coverage > 0) at(x, y) += coverage * (color - at(x, y));
    }
}

void Canvas::Write(const std::string& text, const Vector2d& origin, double size, double stroke_width, double slant,
                   const Color& color) {
  std::vector<Stroke> strokes;
  double x = 0;
  for (const char letter : text) {
    const auto glyph = Glyphs().find(letter);
    ETUDE_CHECK(glyph != Glyphs().end(), "no glyph for '{}'", letter);
    for (Stroke stroke : glyph->second.strokes) {
      for (Vector2d& p : stroke) p = origin + size * Vector2d(x + p.x() + slant * p.y(), -p.y());
      strokes.push_back(std::move(stroke));
    }
    x += glyph->second.advance;
  }
  Paint(Brush(std::move(strokes), stroke_width), color);
}

double Canvas::TextWidth(const std::string& text, double size) {
  double width = 0;
  for (const char letter : text) width += Glyphs().at(letter).advance;
  return width * size;
}

std::vector<std::uint8_t> Canvas::ToTexture() const {
  std::vector<std::uint8_t> bytes(8 + pixels_.size() * 3);
  const std::int32_t size[2] = {width_, height_};
  std::memcpy(bytes.data(), size, 8);
  std::size_t i = 8;
  for (const Color& pixel : pixels_)
    for (int k = 0; k < 3; ++k)
      bytes[i++] = static_cast<std::uint8_t>(std::lround(255 * std::clamp(pixel[k], 0.0, 1.0)));
  return bytes;
}

double Noise(double x, double y, std::uint32_t seed) {
  const double fx = std::floor(x), fy = std::floor(y);
  const auto ix = static_cast<std::int64_t>(fx), iy = static_cast<std::int64_t>(fy);
  const auto ease = [](double t) { return t * t * (3 - 2 * t); };
  const double tx = ease(x - fx), ty = ease(y - fy);
  const double low = std::lerp(Hash(ix, iy, seed), Hash(ix + 1, iy, seed), tx);
  const double high = std::lerp(Hash(ix, iy + 1, seed), Hash(ix + 1, iy + 1, seed), tx);
  return std::lerp(low, high, ty);
}

}  // namespace etude::assets
