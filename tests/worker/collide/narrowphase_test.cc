// SPDX-License-Identifier: Apache-2.0
// Tests worker/collide/narrowphase.cc
#include "worker/collide/narrowphase.h"

#include <gtest/gtest.h>

#include "tests/worker/collide/shapes.h"
#include "worker/collide/separation.h"

namespace etude::collide {
namespace narrowphase_test {

TEST(Narrowphase, KnowsDistancesThatAreEasyByHand) {
  const Shape sphere(Make(GeometryShape::kSphere, {0.1, 0, 0}), 0);
  const Shape box(Make(GeometryShape::kBox, {0.1, 0.2, 0.3}), 0);
  const Shape capsule(Make(GeometryShape::kCapsule, {0.05, 0.2, 0}), 0);
  const Shape cylinder(Make(GeometryShape::kCylinder, {0.05, 0.2, 0}), 0);
  const Shape convex(Make(GeometryShape::kConvex, {0.1, 0.2, 0.3}), 0);
  const Eigen::Isometry3d origin = At(0, 0, 0);

  EXPECT_NEAR(Distance(sphere, origin, sphere, At(0.5, 0, 0)), 0.3, 1e-5);
  EXPECT_NEAR(Distance(box, origin, sphere, At(0, 0.5, 0)), 0.2, 1e-5);
  EXPECT_NEAR(Distance(capsule, origin, box, At(0, 0, 0.6)), 0.05, 1e-5);
  EXPECT_NEAR(Distance(cylinder, origin, box, At(0, 0, 0.6)), 0.1, 1e-5);
  EXPECT_NEAR(Distance(convex, origin, sphere, At(0.4, 0, 0)), 0.2, 1e-5);
  EXPECT_EQ(Distance(box, origin, convex, At(0.15, 0, 0)), 0);
}

TEST(Narrowphase, TouchAgreesWithDistanceForAllPairsOfShapes) {
  Rng rng(7);
  int touching = 0;
  for (const GeometryShape shape_a : kShapes) {
    for (const GeometryShape shape_b : kShapes) {
      const Shape a(Make(shape_a, {0.1, 0.12, 0.08}), 0), b(Make(shape_b, {0.07, 0.15, 0.1}), 0);
      for (int i = 0; i < 100; ++i) {
        const Eigen::Isometry3d X_WA = RandomPose(rng, 0.2);
        const Eigen::Isometry3d X_WB = RandomPose(rng, 0.2);
        const bool touch = Touch(a, X_WA, b, X_WB);
        touching += touch ? 1 : 0;
        EXPECT_EQ(touch, Touch(b, X_WB, a, X_WA));
        EXPECT_EQ(touch, Distance(a, X_WA, b, X_WB) < 1e-9);
      }
    }
  }
  EXPECT_GT(touching, 250);
  EXPECT_LT(touching, 2250);
}

}  // namespace narrowphase_test
}  // namespace etude::collide
