// SPDX-License-Identifier: Apache-2.0
// Tests worker/synthesis/convex_decomposition.cc and hull.cc
#include "worker/synthesis/convex_decomposition.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "services/core/rng.h"
#include "worker/synthesis/drawn_object.h"
#include "worker/synthesis/hull.h"
#include "worker/synthesis/mass.h"

namespace etude::synthesis {
namespace {

using Eigen::Vector3d;

/// How far a point is out of a convex mesh; negative inside.
double Outside(const assets::Mesh& hull, const Vector3d& p) {
  double farthest = -std::numeric_limits<double>::infinity();
  for (const auto& f : hull.faces) {
    const Vector3d& a = hull.positions[f[0]];
    const Vector3d normal = (hull.positions[f[1]] - a).cross(hull.positions[f[2]] - a).normalized();
    farthest = std::max(farthest, normal.dot(p - a));
  }
  return farthest;
}

double NearestVertex(const assets::Mesh& mesh, const Vector3d& p) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const Vector3d& q : mesh.positions) nearest = std::min(nearest, (p - q).norm());
  return nearest;
}

TEST(ConvexHull, OfABoxWithPointsInside) {
  Rng rng(1);
  std::vector<Vector3d> points;
  for (int i = 0; i < 8; ++i) points.emplace_back(i & 1, (i >> 1 & 1) * 2, (i >> 2) * 3);
  for (int i = 0; i < 100; ++i) points.emplace_back(rng.Uniform(), 2 * rng.Uniform(), 3 * rng.Uniform());

  const auto hull = ConvexHull(points);
  ASSERT_TRUE(hull.has_value());
  EXPECT_TRUE(IsWatertight(*hull));
  EXPECT_EQ(hull->positions.size(), 8u);
  EXPECT_EQ(hull->faces.size(), 12u);
  EXPECT_NEAR(Integrate(*hull).mass, 6, 1e-9);
}

TEST(ConvexHull, HoldsAllItsPoints) {
  Rng rng(2);
  std::vector<Vector3d> points;
  // a grid: many points in common planes and lines
  for (int i = 0; i < 125; ++i) points.emplace_back(i % 5, i / 5 % 5, i / 25);
  for (int i = 0; i < 100; ++i) points.emplace_back(rng.Normal() + 2, rng.Normal() + 2, rng.Normal() + 2);

  const auto hull = ConvexHull(points);
  ASSERT_TRUE(hull.has_value());
  EXPECT_TRUE(IsWatertight(*hull));
  for (const Vector3d& p : points) EXPECT_LT(Outside(*hull, p), 1e-4);
}

TEST(ConvexHull, OfPointsInAPlaneIsNothing) {
  EXPECT_FALSE(ConvexHull({{0, 0, 1}, {1, 0, 1}, {0, 1, 1}, {1, 1, 1}, {0.3, 0.4, 1}}).has_value());
  EXPECT_FALSE(ConvexHull({{0, 0, 0}, {1, 0, 0}}).has_value());
}

TEST(FarthestPoints, KeepTheHullNearly) {
  Rng rng(3);
  std::vector<Vector3d> points;
  for (int i = 0; i < 2000; ++i) points.push_back(Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized());

  const auto kept = FarthestPoints(points, 200);
  EXPECT_LE(kept.size(), 200u);
  EXPECT_GT(Integrate(*ConvexHull(kept)).mass, 0.96 * Integrate(*ConvexHull(points)).mass);
}

class Pieces : public testing::TestWithParam<const char*> {};

TEST_P(Pieces, LieOnTheBodyAndCoverIt) {
  for (const int index : {0, 4}) {
    const auto object = DrawObject(GetParam(), index, 1);
    ASSERT_TRUE(object.has_value()) << object.error().message;
    EXPECT_LE(object->pieces.size(), 8u);

    // every corner is a point of the surface, so within a grid step of a vertex
    const double step = 0.05 * object->facts.size_m;
    for (const auto& piece : object->pieces) {
      EXPECT_TRUE(IsWatertight(piece));
      EXPECT_GT(Integrate(piece).mass, 0);
      for (const Vector3d& p : piece.positions) EXPECT_LT(NearestVertex(object->visual, p), step);
    }
    for (const Vector3d& p : object->visual.positions) {
      if (p.z() < kFootHeight - object->facts.rest_height_m) continue;  // the foot's box is there
      double nearest = std::numeric_limits<double>::infinity();
      for (const auto& piece : object->pieces) nearest = std::min(nearest, Outside(piece, p));
      EXPECT_LT(nearest, 0.03 * object->facts.size_m);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Classes, Pieces, testing::Values("apple", "donut", "mug", "strawberry"));

TEST(Pieces, LeaveTheHoleOpen) {
  for (const char* name : {"donut", "mug"})
    for (int index = 0; index < 5; ++index) {
      const auto body = DrawObject(name, index, 1);
      ASSERT_TRUE(body.has_value());
      EXPECT_EQ(body->pieces.size(), static_cast<std::size_t>(PieceOptions{}.sectors)) << name;

      // lines along y, through the body from the front: how wide is what none of the pieces is hit by, and what the
      // pieces surround
      const double half = body->facts.size_m / 2;
      const auto is_hit = [&](double x, double z) {
        for (const auto& piece : body->pieces)
          for (double y = -half; y < half; y += 0.002)
            if (Outside(piece, {x, y, z}) < 0) return true;
        return false;
      };
      std::vector<bool> hit;
      for (double x = -half; x < half; x += 0.001) hit.push_back(is_hit(x, 0.0));
      const auto first = std::find(hit.begin(), hit.end(), true);
      const auto last = std::find(hit.rbegin(), hit.rend(), true).base();
      EXPECT_GE(std::count(first, last, false), 6) << name << " " << index;  // mm
    }
}

}  // namespace
}  // namespace etude::synthesis
