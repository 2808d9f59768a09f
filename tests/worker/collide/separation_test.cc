// SPDX-License-Identifier: Apache-2.0
// Tests worker/collide/separation.cc
#include "worker/collide/separation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/worker/collide/shapes.h"

namespace etude::collide {
namespace separation_test {

using Eigen::Isometry3d;
using Eigen::Vector3d;
// With a rounder hull than a box.
sim::Geometry MakeRound(GeometryShape shape, const Vector3d& size) {
  sim::Geometry geometry = Make(shape, size);
  geometry.vertices.clear();
  Rng rng(3);
  if (shape == GeometryShape::kConvex)
    for (int i = 0; i < 40; ++i)
      geometry.vertices.push_back(Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized().cwiseProduct(size));
  return geometry;
}

// Nearest point of a segment (along z of X, half length h) to p.
Vector3d OnSegment(const Isometry3d& X, double half, const Vector3d& p) {
  const Vector3d local = X.inverse() * p;
  return X * Vector3d(0, 0, std::clamp(local.z(), -half, half));
}

void ExpectConsistent(const Separation& s) {
  EXPECT_NEAR(s.normal.norm(), 1, 1e-9);
  EXPECT_LT((s.p_WA - s.p_WB - s.distance * s.normal).norm(), 1e-9);
}

TEST(Separate, SphereSphereIsExactOnBothSidesOfContact) {
  const Shape a(MakeRound(GeometryShape::kSphere, {0.05, 0, 0}), 0),
      b(MakeRound(GeometryShape::kSphere, {0.03, 0, 0}), 0);
  Rng rng(1);
  int overlapping = 0;
  for (int i = 0; i < 500; ++i) {
    const Isometry3d X_WA = RandomPose(rng, 0.08), X_WB = RandomPose(rng, 0.08);
    const Vector3d between = X_WA.translation() - X_WB.translation();
    const Separation s = Separate(a, X_WA, b, X_WB);
    ExpectConsistent(s);
    EXPECT_NEAR(s.distance, between.norm() - 0.08, 1e-5);
    overlapping += s.distance < 0 ? 1 : 0;
    if (between.norm() > 0.01) {
      EXPECT_GT(s.normal.dot(between.normalized()), 1 - 1e-4);
    }
  }
  EXPECT_GT(overlapping, 50);
}

TEST(Separate, CapsuleCapsuleAndCapsuleBoxAgreeWithSegments) {
  const Shape capsule(MakeRound(GeometryShape::kCapsule, {0.02, 0.1, 0}), 0);
  const Shape sphere(MakeRound(GeometryShape::kSphere, {0.03, 0, 0}), 0);
  const Shape box(MakeRound(GeometryShape::kBox, {0.05, 0.06, 0.07}), 0);
  Rng rng(2);
  int separate = 0;
  for (int i = 0; i < 500; ++i) {
    const Isometry3d X_WA = RandomPose(rng, 0.2), X_WB = RandomPose(rng, 0.2);
    const Vector3d p = X_WB.translation();
    const Separation to_sphere = Separate(capsule, X_WA, sphere, X_WB);
    EXPECT_NEAR(to_sphere.distance, (OnSegment(X_WA, 0.1, p) - p).norm() - 0.05, 1e-5);

    // segment to box: the least over the segment of a convex function, by ternary search
    const auto to_box = [&](double z) {
      const Vector3d local = X_WB.inverse() * (X_WA * Vector3d(0, 0, z));
      const Vector3d size(0.05, 0.06, 0.07);
      return (local - local.cwiseMax(-size).cwiseMin(size)).norm();
    };
    double low = -0.1, high = 0.1;
    for (int k = 0; k < 200; ++k) {
      const double a = low + (high - low) / 3, b = high - (high - low) / 3;
      (to_box(a) < to_box(b) ? high : low) = to_box(a) < to_box(b) ? b : a;
    }
    const double expected = to_box((low + high) / 2) - 0.02;
    const Separation s = Separate(capsule, X_WA, box, X_WB);
    ExpectConsistent(s);
    if (expected <= 0) continue;
    ++separate;
    EXPECT_NEAR(s.distance, expected, 1e-5);
    EXPECT_LT((OnSegment(X_WA, 0.1, s.p_WA) - s.p_WA).norm(), 0.02 + 1e-6);
  }
  EXPECT_GT(separate, 200);
}

TEST(Separate, BoxesAndCylindersByHand) {
  const Shape box(MakeRound(GeometryShape::kBox, {0.1, 0.2, 0.3}), 0);
  const Shape cylinder(MakeRound(GeometryShape::kCylinder, {0.05, 0.2, 0}), 0);

  const Separation corner = Separate(box, At(0, 0, 0), box, At(0.23, 0.44, 0.3));
  EXPECT_NEAR(corner.distance, 0.05, 1e-5);  // an edge to an edge: 3 and 4 cm apart
  EXPECT_LT((corner.normal - Vector3d(-0.6, -0.8, 0)).norm(), 1e-3);

  const Separation deep = Separate(box, At(0, 0, 0), box, At(0.02, 0.39, 0.1));
  EXPECT_NEAR(deep.distance, -0.01, 1e-6);
  EXPECT_LT((deep.normal - Vector3d(0, -1, 0)).norm(), 1e-6);

  const Separation side = Separate(cylinder, At(0, 0, 0), box, At(0.25, 0, 0));
  EXPECT_NEAR(side.distance, 0.1, 1e-5);
  EXPECT_NEAR(side.p_WA.x(), 0.05, 1e-5);
  const Separation top = Separate(cylinder, At(0, 0, 0.495), box, At(0.02, 0.03, 0));
  EXPECT_NEAR(top.distance, -0.005, 1e-6);
  EXPECT_LT((top.normal - Vector3d(0, 0, 1)).norm(), 1e-6);
  const Separation rims = Separate(cylinder, At(0, 0, 0), cylinder, At(0.13, 0, 0.44));
  EXPECT_NEAR(rims.distance, std::hypot(0.03, 0.04), 1e-5);
}

// For convex shapes a gap along some direction is at most the distance, and two points of them at least: where both
// agree, each is proved. Supports are the test's own for boxes, so that the proof does not rest on ours alone.
TEST(Separate, EveryPairOfShapesIsProvedByAPlaneBetweenThem) {
  Rng rng(4);
  int separate = 0;
  for (const GeometryShape shape_a : kShapes) {
    for (const GeometryShape shape_b : kShapes) {
      const Shape a(MakeRound(shape_a, {0.03, 0.06, 0.02}), 0), b(MakeRound(shape_b, {0.05, 0.04, 0.06}), 0);
      for (int i = 0; i < 400; ++i) {
        const Isometry3d X_WA = RandomPose(rng, 0.12), X_WB = RandomPose(rng, 0.12);
        const Separation s = Separate(a, X_WA, b, X_WB);
        ExpectConsistent(s);
        EXPECT_EQ(Separate(a, X_WA, b, X_WB).distance, s.distance);
        const Vector3d far_a = X_WA * a.Support(X_WA.linear().transpose() * -s.normal);
        const Vector3d far_b = X_WB * b.Support(X_WB.linear().transpose() * s.normal);
        const double gap = s.normal.dot(far_a - far_b);
        EXPECT_NEAR(s.distance, gap, 1.1e-5) << static_cast<int>(shape_a) << " " << static_cast<int>(shape_b);
        if (s.distance > 1e-6) {
          ++separate;
          // the witness points are of the shapes: not beyond their supports in any direction
          for (int k = 0; k < 20; ++k) {
            const Vector3d n = Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
            EXPECT_LT(n.dot(s.p_WA - X_WA * a.Support(X_WA.linear().transpose() * n)), 1e-6);
            EXPECT_LT(n.dot(s.p_WB - X_WB * b.Support(X_WB.linear().transpose() * n)), 1e-6);
          }
        }
        EXPECT_EQ(s.distance < -1e-4, Touch(a, X_WA, b, X_WB) && s.distance < -1e-4) << s.distance;
        if (s.distance > 1e-4) {
          EXPECT_FALSE(Touch(a, X_WA, b, X_WB)) << s.distance;
        }
      }
    }
  }
  EXPECT_GT(separate, 5000);
}

TEST(Separate, MovingAlongTheNormalByTheDepthPartsOverlappingShapes) {
  Rng rng(5);
  int overlapping = 0;
  double excess = 0;
  for (const GeometryShape shape_a : kShapes) {
    for (const GeometryShape shape_b : kShapes) {
      const Shape a(MakeRound(shape_a, {0.05, 0.08, 0.06}), 0), b(MakeRound(shape_b, {0.06, 0.07, 0.06}), 0);
      for (int i = 0; i < 60; ++i) {
        Isometry3d X_WA = RandomPose(rng, 0.05), X_WB = RandomPose(rng, 0.05);
        const Separation s = Separate(a, X_WA, b, X_WB);
        if (s.distance >= 0) continue;
        ++overlapping;
        ExpectConsistent(s);
        // no direction of many parts them much sooner
        double least = 1;
        for (int k = 0; k < 400; ++k) {
          const Vector3d n = Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
          least = std::min(least, n.dot(X_WB * b.Support(X_WB.linear().transpose() * n) -
                                        X_WA * a.Support(X_WA.linear().transpose() * -n)));
        }
        excess = std::max(excess, -s.distance - least);
        X_WA.translation() += s.normal * (1e-4 - s.distance);
        EXPECT_FALSE(Touch(a, X_WA, b, X_WB)) << s.distance;
      }
    }
  }
  EXPECT_GT(overlapping, 500);
  EXPECT_LT(excess, 0.012);
}

TEST(Separate, AnswersWhereCentresCoincide) {
  const Shape sphere(MakeRound(GeometryShape::kSphere, {0.05, 0, 0}), 0);
  const Separation s = Separate(sphere, At(0, 0, 0), sphere, At(0, 0, 0));
  ExpectConsistent(s);
  EXPECT_NEAR(s.distance, -0.1, 1e-6);
}

}  // namespace separation_test
}  // namespace etude::collide
