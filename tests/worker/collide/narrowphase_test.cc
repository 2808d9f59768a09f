// SPDX-License-Identifier: Apache-2.0
// Tests worker/collide/narrowphase.cc and worker/collide/pieces.cc
#include "worker/collide/narrowphase.h"

#include <gtest/gtest.h>

#include "services/core/rng.h"
#include "worker/collide/pieces.h"
#include "worker/collide/separation.h"

namespace etude::collide {
namespace {

using GeometryShape = sim::Geometry::Shape;

sim::Geometry Make(GeometryShape shape, const Eigen::Vector3d& size) {
  sim::Geometry geometry;
  geometry.name = geometry.body = "piece";
  geometry.shape = shape;
  geometry.size = size;
  if (shape == GeometryShape::kConvex)
    for (int corner = 0; corner < 8; ++corner)
      geometry.vertices.emplace_back(corner & 1 ? size.x() : -size.x(), corner & 2 ? size.y() : -size.y(),
                                     corner & 4 ? size.z() : -size.z());
  return geometry;
}

Eigen::Isometry3d At(double x, double y, double z) { return Eigen::Isometry3d(Eigen::Translation3d(x, y, z)); }

Pose RandomPose(Rng& rng, double reach) {
  Pose X;
  X.p = {rng.Uniform(-reach, reach), rng.Uniform(-reach, reach), rng.Uniform(-reach, reach)};
  X.q = Eigen::Quaterniond(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal()).normalized();
  return X;
}

constexpr GeometryShape kShapes[] = {GeometryShape::kBox, GeometryShape::kSphere, GeometryShape::kCapsule,
                                     GeometryShape::kCylinder, GeometryShape::kConvex};

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
        const Eigen::Isometry3d X_WA = internal::ToIsometry(RandomPose(rng, 0.2));
        const Eigen::Isometry3d X_WB = internal::ToIsometry(RandomPose(rng, 0.2));
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

TEST(Piece, NearIsNeverLessThanTheMarginAndLittleMore) {
  constexpr double kMargin = 0.02;
  Rng rng(8);
  int near_misses = 0;
  for (const GeometryShape shape_a : kShapes) {
    for (const GeometryShape shape_b : kShapes) {
      internal::Piece a(Make(shape_a, {0.1, 0.12, 0.08}), internal::Role::kArm, 0);
      internal::Piece b(Make(shape_b, {0.07, 0.15, 0.1}), internal::Role::kObject, -1);
      a.SetMargin(kMargin);
      b.SetMargin(kMargin);
      for (int i = 0; i < 200; ++i) {
        a.Place(internal::ToIsometry(RandomPose(rng, 0.2)));
        b.Place(internal::ToIsometry(RandomPose(rng, 0.2)));
        const double distance = Distance(a.shape(), a.X_WG(), b.shape(), b.X_WG());
        EXPECT_LE(internal::AabbGap(a, b), distance + 1e-6);
        if (distance < kMargin - 1e-5) {
          EXPECT_TRUE(internal::Near(a, b, kMargin)) << distance;
        }
        if (distance > kMargin * 1.74) {
          EXPECT_FALSE(internal::Near(a, b, kMargin)) << distance;
        }
        if (distance > 0 && distance < kMargin) ++near_misses;
      }
    }
  }
  EXPECT_GT(near_misses, 50);
}

}  // namespace
}  // namespace etude::collide
