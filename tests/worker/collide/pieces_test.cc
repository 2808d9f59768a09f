// SPDX-License-Identifier: Apache-2.0
// Tests worker/collide/pieces.cc, and the room that a checker keeps between the bodies of the arm
#include "worker/collide/pieces.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <numbers>
#include <set>
#include <string>
#include <utility>

#include "tests/worker/collide/shapes.h"
#include "tests/worker/sim/scene_fixture.h"
#include "worker/collide/checker.h"
#include "worker/collide/separation.h"

namespace etude::collide::internal {
namespace pieces_test {

using Eigen::Isometry3d;
using Eigen::Vector3d;

Piece PieceOf(GeometryShape shape, const Vector3d& size, Role role = Role::kArm) {
  return {Make(shape, size), role, 0};
}

// The box of a piece ends where the piece does: at its farthest point along each axis.
TEST(Piece, HasTheSmallestBoxAroundIt) {
  Rng rng(1);
  for (const GeometryShape shape : kShapes) {
    sim::Geometry geometry = Make(shape, {0.05, 0.12, 0.08});
    geometry.X_BG = {{0.1, -0.2, 0.3}, Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5)};
    Piece piece(geometry, Role::kArm, 0);
    for (int i = 0; i < 100; ++i) {
      const Isometry3d X_WB = RandomPose(rng, 1);
      piece.Place(X_WB);
      const Isometry3d X_WG = X_WB * ToIsometry(geometry.X_BG);
      EXPECT_TRUE(piece.X_WG().isApprox(X_WG, 1e-12));
      for (int axis = 0; axis < 3; ++axis) {
        const Vector3d up = X_WG.linear().transpose() * Vector3d::Unit(axis);  // in G
        EXPECT_NEAR(piece.upper()[axis], (X_WG * piece.shape().Support(up))[axis], 1e-9) << static_cast<int>(shape);
        EXPECT_NEAR(piece.lower()[axis], (X_WG * piece.shape().Support(-up))[axis], 1e-9) << static_cast<int>(shape);
      }
    }
  }
}

// The vertices of a mesh need not be about its origin.
TEST(Piece, OfAMeshHasItsBoxWhereItsVerticesAre) {
  sim::Geometry mesh = Make(GeometryShape::kConvex, {0.1, 0.1, 0.1});
  for (Vector3d& vertex : mesh.vertices) vertex += Vector3d(1, 2, 3);
  Piece piece(mesh, Role::kArm, 0);
  piece.Place(At(0, 0, 10));
  EXPECT_TRUE(piece.lower().isApprox(Vector3d(0.9, 1.9, 12.9), 1e-12)) << piece.lower().transpose();
  EXPECT_TRUE(piece.upper().isApprox(Vector3d(1.1, 2.1, 13.1), 1e-12)) << piece.upper().transpose();
}

TEST(AabbGap, IsTheLargestGapAlongAnAxis) {
  Piece a = PieceOf(GeometryShape::kBox, {0.1, 0.2, 0.3}), b = PieceOf(GeometryShape::kBox, {0.1, 0.1, 0.1});
  a.Place(At(0, 0, 0));
  const auto gap = [&](double x, double y, double z) {
    b.Place(At(x, y, z));
    EXPECT_EQ(AabbGap(a, b), AabbGap(b, a));
    return AabbGap(a, b);
  };
  EXPECT_NEAR(gap(0.5, 0, 0), 0.3, 1e-12);
  EXPECT_NEAR(gap(-0.5, 0.4, 0), 0.3, 1e-12) << "0.1 along y is less";
  EXPECT_NEAR(gap(0, -0.4, -1), 0.6, 1e-12);
  EXPECT_NEAR(gap(0.15, 0, 0), -0.05, 1e-12) << "they overlap, least along x";
}

// What it leaves out must be what FCL would find apart.
TEST(CapsuleGap, IsNoMoreThanTheDistanceAndExactForCapsules) {
  Rng rng(5);
  const auto round = [](GeometryShape shape) {
    return shape == GeometryShape::kCapsule || shape == GeometryShape::kSphere;
  };
  for (const GeometryShape shape_a : kShapes) {
    for (const GeometryShape shape_b : kShapes) {
      Piece a = PieceOf(shape_a, {0.05, 0.12, 0.08}), b = PieceOf(shape_b, {0.04, 0.03, 0.1});
      for (int i = 0; i < 100; ++i) {
        a.Place(RandomPose(rng, 0.3));
        b.Place(RandomPose(rng, 0.3));
        const double distance = Separate(a.shape(), a.X_WG(), b.shape(), b.X_WG()).distance, gap = CapsuleGap(a, b);
        EXPECT_NEAR(gap, CapsuleGap(b, a), 1e-12);
        EXPECT_LE(gap, std::max(0.0, distance + 1e-5));
        if (distance > 0 && round(shape_a) && round(shape_b)) {
          EXPECT_NEAR(gap, distance, 1e-5);
        }
      }
    }
  }
}

TEST(CapsuleGap, IsThatOfParallelAndCrossedAxes) {
  Piece a = PieceOf(GeometryShape::kCapsule, {0.1, 1, 0}), b = PieceOf(GeometryShape::kCapsule, {0.1, 1, 0});
  a.Place(At(0, 0, 0));
  b.Place(At(0.5, 0, 0.3));
  EXPECT_NEAR(CapsuleGap(a, b), 0.3, 1e-12) << "side by side";
  b.Place(At(0, 0, 2.5));
  EXPECT_NEAR(CapsuleGap(a, b), 0.3, 1e-12) << "end to end";
  b.Place(At(0.4, 0, 0.2) * Eigen::AngleAxisd(std::numbers::pi / 2, Vector3d::UnitX()));
  EXPECT_NEAR(CapsuleGap(a, b), 0.2, 1e-12) << "crossed";
}

TEST(Near, SaysWhatTheGrownShapesSay) {
  Rng rng(6);
  constexpr double kMargin = 0.02;
  int touching = 0, apart = 0;
  for (const GeometryShape shape_a : kShapes) {
    for (const GeometryShape shape_b : kShapes) {
      Piece a = PieceOf(shape_a, {0.05, 0.12, 0.08}), b = PieceOf(shape_b, {0.04, 0.03, 0.1});
      a.SetMargin(kMargin);
      if (!a.inflated()) continue;
      for (int i = 0; i < 100; ++i) {
        a.Place(RandomPose(rng, 0.2));
        b.Place(RandomPose(rng, 0.2));
        // the grown shape reaches further than the margin at its corners: what the box leaves out is left out
        const bool expected = AabbGap(a, b) <= kMargin && Touch(*a.inflated(), a.X_WG(), b.shape(), b.X_WG());
        EXPECT_EQ(Near(a, b, kMargin), expected);
        ++(expected ? touching : apart);
      }
    }
  }
  EXPECT_GT(touching, 300);
  EXPECT_GT(apart, 300);
}

TEST(Piece, IsGrownByTheMarginThatWasSetLast) {
  for (const GeometryShape shape : kShapes) {
    Piece piece = PieceOf(shape, {0.05, 0.06, 0.07});
    EXPECT_FALSE(piece.inflated());
    piece.SetMargin(0.02);
    if (shape == GeometryShape::kConvex) {
      EXPECT_FALSE(piece.inflated()) << "its distance is asked for";
      continue;
    }
    ASSERT_TRUE(piece.inflated());
    EXPECT_NEAR(piece.inflated()->Support(Vector3d::UnitX()).x(), 0.07, 1e-12);
    piece.SetMargin(0.01);
    EXPECT_NEAR(piece.inflated()->Support(Vector3d::UnitX()).x(), 0.06, 1e-12);
    piece.SetMargin(0);
    EXPECT_FALSE(piece.inflated());
  }
}

TEST(Piece, OfTheArmIsGrownByTheRoomThatTheArmKeeps) {
  for (const GeometryShape shape : kShapes) {
    const Piece arm = PieceOf(shape, {0.05, 0.06, 0.07}), object = PieceOf(shape, {0.05, 0.06, 0.07}, Role::kObject);
    for (const bool apart : {false, true}) {
      EXPECT_FALSE(object.self_inflated(apart));
      ASSERT_EQ(arm.self_inflated(apart).has_value(), shape != GeometryShape::kConvex);
      if (!arm.self_inflated(apart)) continue;
      EXPECT_NEAR(arm.self_inflated(apart)->Support(Vector3d::UnitX()).x(), 0.05 + (apart ? 0.012 : 0.002), 1e-12);
    }
  }
}

// Two pieces of the arm with their faces, or poles, `gap` apart along x.
bool NearAcross(GeometryShape shape_a, GeometryShape shape_b, double gap, double margin, bool apart) {
  Piece a = PieceOf(shape_a, {0.05, 0.05, 0.05}), b = PieceOf(shape_b, {0.05, 0.05, 0.05});
  a.Place(At(0, 0, 0));
  b.Place(At(0.1 + gap, 0, 0));
  return NearSelf(a, b, margin, apart);
}

TEST(NearSelf, KeepsTwoMillimetresAndTwelveOfWhatIsApartAtHome) {
  using enum sim::Geometry::Shape;
  for (const auto& [a, b] : {std::pair{kSphere, kSphere},
                             {kSphere, kConvex},
                             {kConvex, kSphere},
                             {kConvex, kConvex},
                             {kBox, kSphere},
                             {kBox, kConvex}})
    for (const double margin : {kSelfMargin, 0.02, 0.05}) {
      const std::string what = std::to_string(static_cast<int>(a)) + " " + std::to_string(static_cast<int>(b));
      EXPECT_TRUE(NearAcross(a, b, 0.0015, margin, false)) << what;
      EXPECT_FALSE(NearAcross(a, b, 0.0025, margin, false)) << what << ": whatever is kept from others";
      EXPECT_TRUE(NearAcross(a, b, 0.0115, margin, true)) << what;
      EXPECT_FALSE(NearAcross(a, b, 0.0125, margin, true)) << what;
    }
}

TEST(NearSelf, BelowItsMarginIsContactAlone) {
  for (const double margin : {0.0, 0.0019})
    for (const bool apart : {false, true}) {
      EXPECT_FALSE(NearAcross(GeometryShape::kSphere, GeometryShape::kSphere, 0.0005, margin, apart));
      EXPECT_TRUE(NearAcross(GeometryShape::kSphere, GeometryShape::kSphere, -0.0005, margin, apart));
    }
}

TEST(Piece, NearIsNeverLessThanTheMarginAndLittleMore) {
  constexpr double kMargin = 0.02;
  Rng rng(8);
  int near_misses = 0;
  for (const GeometryShape shape_a : kShapes) {
    for (const GeometryShape shape_b : kShapes) {
      Piece a(Make(shape_a, {0.1, 0.12, 0.08}), Role::kArm, 0);
      Piece b(Make(shape_b, {0.07, 0.15, 0.1}), Role::kObject, -1);
      a.SetMargin(kMargin);
      b.SetMargin(kMargin);
      for (int i = 0; i < 200; ++i) {
        a.Place(RandomPose(rng, 0.2));
        b.Place(RandomPose(rng, 0.2));
        const double distance = Distance(a.shape(), a.X_WG(), b.shape(), b.X_WG());
        EXPECT_LE(AabbGap(a, b), distance + 1e-6);
        if (distance < kMargin - 1e-5) {
          EXPECT_TRUE(Near(a, b, kMargin)) << distance;
        }
        if (distance > kMargin * 1.74) {
          EXPECT_FALSE(Near(a, b, kMargin)) << distance;
        }
        if (distance > 0 && distance < kMargin) ++near_misses;
      }
    }
  }
  EXPECT_GT(near_misses, 50);
}

// What a checker calls free has the room, and what it refuses for it has not.
TEST(SelfRoom, IsKeptByEveryConfigurationThatIsFree) {
  const auto scene = sim::FullScene();
  const sim::ArmInfo& arm = scene->arm();
  Checker checker(scene);
  using Pair = std::pair<std::string, std::string>;
  std::set<Pair> self;
  for (const auto& [a, b] : checker.SelfPairs()) self.insert({{a, b}, {b, a}});
  std::map<Pair, double> at_home;
  for (const Proximity& p : checker.Distances(arm.q_home, 0.1, PairSet::kSelfToo))
    at_home[{p.body_a, p.body_b}] = p.distance;
  const auto room = [&](const Proximity& p) {
    const auto home = at_home.find({p.body_a, p.body_b});
    return home == at_home.end() || home->second > 2 * kSelfRoom + 1e-4 ? kSelfRoom : kSelfMargin;
  };

  Rng rng(9);
  int free = 0, refused_for_room = 0;
  for (int i = 0; i < 1000; ++i) {
    Eigen::VectorXd q = arm.q_home;
    const double spread = i % 2 == 0 ? 0.8 : 2.5;
    for (double& angle : q) angle += rng.Uniform(-spread, spread);
    q = q.cwiseMax(arm.q_min).cwiseMin(arm.q_max);
    const auto collision = checker.Check(q, kSelfMargin);
    if (collision) {
      if (!self.contains({collision->body_a, collision->body_b}) || checker.Check(q, 0)) continue;
      ++refused_for_room;
      // grown boxes and cylinders are too wide at their corners, see the folder's README
      EXPECT_LT(collision->distance, 1.74 * kSelfRoom) << collision->body_a << " " << collision->body_b;
      continue;
    }
    ++free;
    for (const Proximity& p : checker.Distances(q, 0.03, PairSet::kSelfToo)) {
      if (!self.contains({p.body_a, p.body_b})) continue;
      EXPECT_GE(p.distance, room(p) - 5e-5) << p.body_a << " " << p.body_b;
    }
  }
  EXPECT_GT(free, 50);
  EXPECT_GT(refused_for_room, 2);
}

}  // namespace pieces_test
}  // namespace etude::collide::internal
