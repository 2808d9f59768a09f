// SPDX-License-Identifier: Apache-2.0
// Tests worker/assets/canvas.cc
#include "worker/assets/canvas.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "services/core/rng.h"

namespace etude::assets {
namespace canvas_test {

using Eigen::Vector2d;

/// px of white that this paints on a black canvas, by coverage.
double Painted(const Shape& shape, int size = 64) {
  Canvas canvas(size, size, Color::Zero());
  canvas.Paint(shape, Color::Ones());
  double sum = 0;
  for (int y = 0; y < size; ++y)
    for (int x = 0; x < size; ++x) sum += canvas.at(x, y).x();
  return sum;
}

TEST(Canvas, ShapesCoverTheirArea) {
  for (const double radius : {3.0, 7.5, 20.25})
    EXPECT_NEAR(Painted(Disc({31.3, 30.8}, radius)), std::numbers::pi * radius * radius, 0.5 + 0.1 * radius);
  EXPECT_NEAR(Painted(Rectangle({10, 20}, {30, 25})), 20 * 5, 1e-9) << "along the pixels it is exact";
  EXPECT_NEAR(Painted(Rectangle({10.25, 20}, {30.5, 25})), 20.25 * 5, 1e-9) << "a pixel by its share";
  // a line with half a disc at either end
  EXPECT_NEAR(Painted(Brush({{{12, 12}, {42, 52}}}, 6)), 50 * 6 + std::numbers::pi * 9, 3);
  EXPECT_EQ(Painted(Disc({-40, -40}, 20)), 0) << "off the canvas";
}

TEST(Canvas, CoverageMixesColours) {
  Canvas canvas(3, 1, Color(1, 0, 0));
  canvas.Paint(Rectangle({1.5, 0}, {9, 9}), Color(0, 0, 1));
  EXPECT_EQ(canvas.at(0, 0), Color(1, 0, 0));
  EXPECT_LT((canvas.at(1, 0) - Color(0.5, 0, 0.5)).norm(), 1e-12);
  EXPECT_EQ(canvas.at(2, 0), Color(0, 0, 1));
}

TEST(Canvas, ArcsGoFromAngleToAngleOnTheirEllipse) {
  const Stroke arc = Arc({10, 20}, {4, 2}, 0.3, 2.0);
  EXPECT_LT((arc.front() - Vector2d(10 + 4 * std::cos(0.3), 20 + 2 * std::sin(0.3))).norm(), 1e-12);
  EXPECT_LT((arc.back() - Vector2d(10 + 4 * std::cos(2.0), 20 + 2 * std::sin(2.0))).norm(), 1e-12);
  for (const Vector2d& p : arc) EXPECT_NEAR(std::hypot((p.x() - 10) / 4, (p.y() - 20) / 2), 1, 1e-12);
}

TEST(Canvas, TextStaysOnItsLineAndBetweenItsEnds) {
  const std::string text = "PEPSI";
  const double size = 20, width = Canvas::TextWidth(text, size);
  EXPECT_NEAR(width, 2 * Canvas::TextWidth(text, size / 2), 1e-12);
  EXPECT_NEAR(width, Canvas::TextWidth("PEP", size) + Canvas::TextWidth("SI", size), 1e-12);
  Canvas canvas(120, 60, Color::Zero());
  canvas.Write(text, {10, 40}, size, 2, 0, Color::Ones());
  double ink = 0;
  for (int y = 0; y < canvas.height(); ++y)
    for (int x = 0; x < canvas.width(); ++x) {
      ink += canvas.at(x, y).x();
      const bool within = x >= 8 && x <= 12 + width && y >= 18 && y <= 42;
      EXPECT_TRUE(within || canvas.at(x, y).x() == 0) << x << " " << y;
    }
  EXPECT_GT(ink, 200);
}

TEST(Canvas, ATexturesBytesAreClampedAndRounded) {
  Canvas canvas(2, 1, Color(-1, 0.5, 2));
  canvas.at(1, 0) = Color(0.1, 0.2, 0.3);
  const std::vector<std::uint8_t> expected{2, 0, 0, 0, 1, 0, 0, 0, 0, 128, 255, 26, 51, 77};
  EXPECT_EQ(canvas.ToTexture(), expected);
}

TEST(Noise, IsSmoothEvenAndItsOwnForEachSeed) {
  Rng rng(4);
  constexpr double kStep = 1e-4;
  double sum = 0, other = 0, square = 0;
  constexpr int kPoints = 20000;
  for (int i = 0; i < kPoints; ++i) {
    const double x = rng.Uniform(-1000, 1000), y = rng.Uniform(-1000, 1000);
    const double value = Noise(x, y, 7);
    ASSERT_TRUE(value >= 0 && value <= 1);
    ASSERT_LT(std::abs(Noise(x + kStep, y, 7) - value), 1.6 * kStep) << "its slope is 1.5 at most";
    sum += value;
    square += value * value;
    other += (value - 0.5) * (Noise(x, y, 8) - 0.5);
  }
  EXPECT_NEAR(sum / kPoints, 0.5, 0.01);
  EXPECT_NEAR(other / kPoints, 0, 0.003) << "another seed says nothing about this one";
  // the ease's squares average 13/35 a corner pair and axis: variance (26/35)^2 / 12
  EXPECT_NEAR(square / kPoints - 0.25, std::pow(26.0 / 35, 2) / 12, 0.003);
}

TEST(Noise, IsFlatAtWholeNumbers) {
  for (int x = -5; x < 5; ++x)
    for (const double step : {-1e-4, 1e-4}) EXPECT_NEAR(Noise(x + step, 3, 1), Noise(x, 3, 1), 1e-6);
}

}  // namespace canvas_test
}  // namespace etude::assets
