// SPDX-License-Identifier: Apache-2.0
// A small picture with anti-aliased shapes, for procedural textures. Deterministic: no library
// draws here.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

namespace etude::assets {

using Color = Eigen::Vector3d;  ///< red, green, blue in 0..1

/// Signed distance in px of a point (x right, y down) to a shape; negative inside.
using Shape = std::function<double(const Eigen::Vector2d&)>;
/// A brush stroke: its centre line.
using Stroke = std::vector<Eigen::Vector2d>;

Shape Disc(const Eigen::Vector2d& centre, double radius);
Shape Rectangle(const Eigen::Vector2d& low, const Eigen::Vector2d& high);
/// All points within width / 2 of one of the strokes.
Shape Brush(std::vector<Stroke> strokes, double width);
/// Points of an ellipse's arc from angle a to b (rad, y down: clockwise when b > a).
Stroke Arc(const Eigen::Vector2d& centre, const Eigen::Vector2d& radii, double a, double b);

class Canvas {
 public:
  Canvas(int width, int height, const Color& background);

  int width() const { return width_; }
  int height() const { return height_; }
  Color& at(int x, int y) { return pixels_[static_cast<std::size_t>(y) * width_ + x]; }

  void Paint(const Shape& shape, const Color& color);
  /// Writes `text` (letters of the brands and labels we need) in strokes: `origin` is the left end
  /// of the base line, `size` the height of a capital, `slant` the shift per height.
  void Write(const std::string& text, const Eigen::Vector2d& origin, double size, double stroke_width, double slant,
             const Color& color);
  /// Width of that text in px.
  static double TextWidth(const std::string& text, double size);

  /// MuJoCo's custom texture format: int32 width, int32 height, RGB bytes, first row first.
  std::vector<std::uint8_t> ToTexture() const;

 private:
  int width_, height_;
  std::vector<Color> pixels_;
};

/// Smooth value noise in 0..1 of a point; the same on every machine.
double Noise(double x, double y, std::uint32_t seed);

/// Distance to the segment from a to b, which may be one point.
double SegmentDistance(const Eigen::Vector2d& p, const Eigen::Vector2d& a, const Eigen::Vector2d& b);

}  // namespace etude::assets
