// SPDX-License-Identifier: Apache-2.0
// Tests worker/synthesis/convex_decomposition.cc and hull.cc
#include "worker/synthesis/convex_decomposition.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "services/core/rng.h"
#include "tests/worker/synthesis/shapes.h"
#include "worker/synthesis/drawn_object.h"
#include "worker/synthesis/hull.h"
#include "worker/synthesis/mass.h"

namespace etude::synthesis {
namespace convex_decomposition_test {

using Eigen::Vector3d;

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

// A plane through three points that has no point on its other side is a side of the hull: all of them, tried out.
double HullVolumeByAllPlanes(const std::vector<Vector3d>& points) {
  double volume = 0;
  const int n = static_cast<int>(points.size());
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      for (int k = 0; k < n; ++k) {
        if (i >= j || i >= k || j == k) continue;
        const Vector3d normal = (points[j] - points[i]).cross(points[k] - points[i]);
        const bool is_side = std::none_of(points.begin(), points.end(),
                                          [&](const Vector3d& p) { return normal.dot(p - points[i]) > 1e-12; });
        if (is_side) volume += points[i].dot(points[j].cross(points[k])) / 6;
      }
  return volume;
}

TEST(ConvexHull, IsThatOfAllPlanesTriedOut) {
  Rng rng(4);
  for (int round = 0; round < 30; ++round) {
    const std::vector<Vector3d> points = NormalPoints(5 + static_cast<int>(rng.Below(20)), rng);
    const auto hull = ConvexHull(points);
    ASSERT_TRUE(hull.has_value());
    EXPECT_NEAR(Integrate(*hull).mass, HullVolumeByAllPlanes(points), 1e-3);
    EXPECT_EQ(hull->faces.size(), 2 * hull->positions.size() - 4) << "Euler, for triangles";
  }
}

TEST(ConvexHull, OfPointsThatStandTwiceAndOfTheOctahedron) {
  std::vector<Vector3d> points;
  for (int k = 0; k < 3; ++k)
    for (const double sign : {-1.0, 1.0, -1.0}) points.push_back(sign * Vector3d::Unit(k));
  const auto hull = ConvexHull(points);
  ASSERT_TRUE(hull.has_value());
  EXPECT_EQ(hull->positions.size(), 6u);
  EXPECT_EQ(hull->faces.size(), 8u);
  EXPECT_NEAR(Integrate(*hull).mass, 4.0 / 3, 1e-12);
}

TEST(FittedHull, HasFewCornersAllOfThePointsAndNearlyTheirVolume) {
  Rng rng(5);
  for (const int count : {8, 16, 64}) {
    std::vector<Vector3d> points = NormalPoints(600, rng);
    for (Vector3d& p : points) p = p.normalized().cwiseProduct(Vector3d(1, 2, 0.5));
    const auto fitted = FittedHull(points, count);
    ASSERT_TRUE(fitted.has_value());
    EXPECT_LE(fitted->positions.size(), static_cast<std::size_t>(count));
    for (const Vector3d& p : fitted->positions) EXPECT_THAT(points, testing::Contains(p));
    const double share = Integrate(*fitted).mass / (4 * std::numbers::pi / 3);
    EXPECT_GT(share, count == 64 ? 0.85 : count == 16 ? 0.55 : 0.3) << count;
    EXPECT_LT(share, 1) << "within the ellipsoid";
  }
  EXPECT_FALSE(FittedHull({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, 8).has_value());
}

TEST(ConvexPieces, AConvexBodyIsOnePiece) {
  for (const assets::Mesh& body : {Box({0.1, 0.2, 0.3}, {0, 0, 0}), Cylinder(0.1, 0.5, 24)}) {
    const auto pieces = ConvexPieces(body, std::nullopt);
    ASSERT_EQ(pieces.size(), 1u);
    EXPECT_NEAR(Integrate(pieces[0]).mass, Integrate(body).mass, 1e-6);
  }
}

// A roof: convex on either side of its ridge at x = 0.1.
TEST(ConvexPieces, ABendIsCutWhereItMustBe) {
  // both ends are fans from a corner that sees all of them: the first and the last
  const assets::Mesh roof =
      assets::Extrude({{0.1, 0.15}, {0, 0.1}, {0, 0}, {0.1, 0.05}, {0.2, 0}, {0.2, 0.1}, {0.11, 0.145}}, 0.03, false);
  const double body = 0.06 * 0.2 * 0.1;
  ASSERT_NEAR(Integrate(roof).mass, body, 1e-12);
  const auto one = ConvexPieces(roof, std::nullopt, {.slices = 1});
  ASSERT_EQ(one.size(), 1u);
  EXPECT_NEAR(Integrate(one[0]).mass, body + 0.06 * 0.2 * 0.05 / 2, 1e-9) << "the hull fills what is under it";
  const auto two = ConvexPieces(roof, std::nullopt);
  ASSERT_EQ(two.size(), 2u) << "no more slices than do";
  EXPECT_NEAR(Integrate(two[0]).mass + Integrate(two[1]).mass, body, 1e-9);
}

TEST(ConvexPieces, SlicesShareABodyOutAlongItsLongestAxis) {
  Rng rng(6);
  for (int round = 0; round < 10; ++round) {
    std::vector<Vector3d> points = NormalPoints(30, rng);
    for (Vector3d& p : points) p.y() *= 4;
    const assets::Mesh body = *ConvexHull(points);
    // less than the body may the pieces hold: never, so that there are as many slices as may be
    const auto pieces = ConvexPieces(body, std::nullopt, {.slices = 4, .fill = -1, .points = 1000});
    ASSERT_EQ(pieces.size(), 4u);
    double sum = 0;
    for (const auto& piece : pieces) {
      EXPECT_TRUE(IsWatertight(piece));
      sum += Integrate(piece).mass;
    }
    EXPECT_NEAR(sum, Integrate(body).mass, 1e-3 * sum);
  }
}

TEST(ConvexPieces, OfARingLeaveItsMiddleOpen) {
  std::vector<assets::ProfilePoint> profile;
  for (int i = 0; i <= 24; ++i) {
    const double angle = 2 * std::numbers::pi * (i % 24) / 24;
    profile.push_back({1 + 0.3 * std::cos(angle), 0.3 * std::sin(angle), 0});
  }
  const assets::Mesh ring = assets::Lathe(profile, 48);
  ASSERT_TRUE(IsWatertight(ring));
  for (const int sectors : {6, 8, 12}) {
    const auto pieces = ConvexPieces(ring, Hole{}, {.sectors = sectors, .points = 200});
    ASSERT_EQ(pieces.size(), static_cast<std::size_t>(sectors));
    // chords cut into the hole as far as half a sector's angle takes them
    const double open = 0.7 * std::cos(std::numbers::pi / sectors) - 0.02;
    for (const auto& piece : pieces)
      for (double angle = 0; angle < 6.28; angle += 0.1)
        EXPECT_GT(Outside(piece, {open * std::cos(angle), open * std::sin(angle), 0}), 0) << sectors;
  }
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

}  // namespace convex_decomposition_test
}  // namespace etude::synthesis
