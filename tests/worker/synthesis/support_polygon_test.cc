// SPDX-License-Identifier: Apache-2.0
// Tests worker/synthesis/support_polygon.cc
#include "worker/synthesis/support_polygon.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/worker/synthesis/shapes.h"
#include "worker/synthesis/hull.h"
#include "worker/synthesis/mass.h"

namespace etude::synthesis {
namespace support_polygon_test {

using Eigen::Vector2d;
using Eigen::Vector3d;

double Lowest(const assets::Mesh& mesh) {
  double low = mesh.positions[0].z();
  for (const Vector3d& p : mesh.positions) low = std::min(low, p.z());
  return low;
}

/// A cone on its tip: its radius at a height is that height.
assets::Mesh ConeOnItsTip(double height) { return assets::Lathe({{0, 0, 1}, {height, height, 0}, {0, height, 0}}, 64); }

TEST(FlattenSupport, WhatStandsFlatIsLeftAsItIs) {
  assets::Mesh box = Box({0.04, 0.03, 0.05}, {0.01, -0.02, 0.3});
  const std::vector<Vector3d> before = box.positions;
  const SupportPolygon foot = FlattenSupport(box);
  EXPECT_EQ(box.positions, before);
  EXPECT_LT((foot.centre - Vector2d(0.01, -0.02)).norm(), 1e-9);
  EXPECT_LT((foot.half - Vector2d(0.55 * 0.04, 0.84 * 0.03)).norm(), 1e-9) << "long along y, within the underside";
}

// before, a die of 3 cm and a battery on its end lost a tenth of their height
TEST(FlattenSupport, WhatIsNarrowAndStandsFlatIsLeftAsItIs) {
  for (assets::Mesh body : {Box({0.01, 0.01, 0.03}, {0, 0, 0}), Box({0.015, 0.015, 0.015}, {0, 0, 0.1})}) {
    const std::vector<Vector3d> before = body.positions;
    EXPECT_GT(FlattenSupport(body).half.minCoeff(), 0);
    EXPECT_EQ(body.positions, before);
  }
}

TEST(FlattenSupport, ATipIsPressedFlatAsFarAsTheFootNeeds) {
  assets::Mesh cone = ConeOnItsTip(0.2);
  const SupportPolygon foot = FlattenSupport(cone, {.least_half = 0.007});
  EXPECT_GE(foot.half.y(), 0.007);
  EXPECT_GE(foot.half.x(), 0.0035);
  EXPECT_LT(foot.centre.norm(), 1e-3);
  // at a height h the circle's rectangle is 0.84 h long; a twenty-fourth of the deepest more than that at most
  const double needed = 0.007 / 0.835, step = 0.1 * 0.2 / 24;
  const double plane = Lowest(cone) / 0.99;  // the tip keeps a hundredth of its height below the plane
  EXPECT_GE(plane, 0.007 / 0.845);
  EXPECT_LE(plane, needed + step);
  EXPECT_TRUE(IsWatertight(cone));
}

TEST(FlattenSupport, PressesNoMoreThanItMay) {
  for (const double deepest : {0.05, 0.10}) {
    assets::Mesh cone = ConeOnItsTip(0.1);
    const SupportPolygon foot = FlattenSupport(cone, {.least_half = 0.05, .deepest = deepest});
    EXPECT_NEAR(Lowest(cone), 0.99 * deepest * 0.1, 1e-9);
    EXPECT_NEAR(foot.half.y(), 0.84 * deepest * 0.1, 0.02 * deepest * 0.1);
  }
}

TEST(FlattenSupport, StandsWithinTheCutOfAnyBody) {
  Rng rng(7);
  for (int round = 0; round < 40; ++round) {
    std::vector<Vector3d> points = NormalPoints(40, rng);
    for (Vector3d& p : points) p *= 0.02;
    const assets::Mesh body = *ConvexHull(points);
    assets::Mesh flat = body;
    const SupportPolygon foot = FlattenSupport(flat, {.least_half = 0.008, .deepest = 0.15});

    double plane = Lowest(body);  // everything above it stays, everything below goes up to it but for a hundredth
    for (std::size_t i = 0; i < flat.positions.size(); ++i) {
      const double moved = flat.positions[i].z() - body.positions[i].z();
      EXPECT_GE(moved, 0);
      if (moved > 0) plane = std::max(plane, (flat.positions[i].z() - 0.01 * body.positions[i].z()) / 0.99);
    }
    EXPECT_TRUE(IsWatertight(flat));
    EXPECT_GT(SmallestFace(flat), 0);
    for (const double x : {-1.0, 1.0})
      for (const double y : {-1.0, 1.0}) {
        const Vector2d corner = foot.centre + foot.half.cwiseProduct(Vector2d(x, y));
        // an edge of the cut is followed to within half of a 64th of a turn
        EXPECT_LT(Outside(body, {corner.x(), corner.y(), plane}), 0.001) << round;
      }
  }
}

}  // namespace support_polygon_test
}  // namespace etude::synthesis
