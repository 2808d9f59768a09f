// SPDX-License-Identifier: Apache-2.0
// Tests worker/synthesis/mass.cc
#include "worker/synthesis/mass.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "services/core/rng.h"
#include "tests/worker/synthesis/shapes.h"
#include "worker/synthesis/hull.h"

namespace etude::synthesis {
namespace mass_test {

using Eigen::Matrix3d;
using Eigen::Vector3d;

TEST(Integrate, IsExactForABox) {
  const Vector3d half(0.1, 0.2, 0.3), centre(1, -2, 3);
  const MassProperties box = Integrate(Box(half, centre));

  const double mass = 8 * half.prod();
  EXPECT_NEAR(box.mass, mass, 1e-12);
  EXPECT_LT((box.centre - centre).norm(), 1e-12);
  Eigen::Matrix3d expected = Eigen::Matrix3d::Zero();
  for (int k = 0; k < 3; ++k) expected(k, k) = mass / 3 * (half.squaredNorm() - half[k] * half[k]);
  EXPECT_LT((box.inertia - expected).norm(), 1e-12);
}

TEST(Integrate, ApproachesASphere) {
  const double radius = 0.04;
  const MassProperties sphere = Integrate(Sphere(radius, 64));

  const double volume = 4 * std::numbers::pi / 3 * std::pow(radius, 3);
  EXPECT_NEAR(sphere.mass, volume, 0.003 * volume);
  const double moment = 0.4 * sphere.mass * radius * radius;
  EXPECT_LT((sphere.inertia - moment * Eigen::Matrix3d::Identity()).norm(), 0.005 * moment);
}

assets::Mesh Joined(const assets::Mesh& a, assets::Mesh b, bool inward) {
  assets::Mesh both = a;
  const int first = static_cast<int>(a.positions.size());
  both.positions.insert(both.positions.end(), b.positions.begin(), b.positions.end());
  for (auto face : b.faces) {
    if (inward) std::swap(face[1], face[2]);
    for (int& vertex : face) vertex += first;
    both.faces.push_back(face);
  }
  return both;
}

// a handle that is wound the other way weighed less than nothing, and the whole had moments that no body has
TEST(TurnOutward, TurnsPartsButNotHollows) {
  const auto body = Box({0.1, 0.1, 0.1}, {0, 0, 0}), handle = Box({0.02, 0.02, 0.02}, {0.2, 0, 0}),
             hollow = Box({0.05, 0.05, 0.05}, {0, 0, 0});
  const auto mass_of = [](assets::Mesh mesh) {
    EXPECT_TRUE(IsWatertight(mesh));
    TurnOutward(mesh);
    return Integrate(mesh).mass;
  };
  const double whole = 0.008 + 0.000064, with_hollow = 0.008 - 0.001;
  EXPECT_NEAR(mass_of(Joined(body, handle, false)), whole, 1e-9);
  EXPECT_NEAR(mass_of(Joined(body, handle, true)), whole, 1e-9);
  EXPECT_NEAR(mass_of(Joined(body, hollow, true)), with_hollow, 1e-9);
  assets::Mesh inside_out = Joined(body, hollow, true);
  for (auto& face : inside_out.faces) std::swap(face[1], face[2]);
  EXPECT_NEAR(mass_of(inside_out), with_hollow, 1e-9);
}

TEST(Integrate, OfATetrahedronIsThatOfItsCorners) {
  Rng rng(1);
  for (int round = 0; round < 50; ++round) {
    const std::vector<Vector3d> corners = NormalPoints(4, rng);
    const auto mesh = ConvexHull(corners);
    ASSERT_TRUE(mesh.has_value());
    const MassProperties found = Integrate(*mesh);

    // the second moments of a simplex are those of its corners and of their sum, by a twentieth
    const Vector3d centre = (corners[0] + corners[1] + corners[2] + corners[3]) / 4;
    Matrix3d edges, second = Matrix3d::Zero();
    for (int k = 0; k < 3; ++k) edges.col(k) = corners[k + 1] - corners[0];
    const double volume = std::abs(edges.determinant()) / 6;
    for (const Vector3d& p : corners) second += volume / 20 * (p - centre) * (p - centre).transpose();
    EXPECT_NEAR(found.mass, volume, 1e-9);
    EXPECT_LT((found.centre - centre).norm(), 1e-9);
    EXPECT_LT((found.inertia - (second.trace() * Matrix3d::Identity() - second)).norm(), 1e-9);
  }
}

TEST(Integrate, OfACylinderAndAConeAreThoseOfTheBooks) {
  const double r = 0.03, h = 0.1;
  const MassProperties cylinder = Integrate(Cylinder(r, h, 400));
  EXPECT_NEAR(cylinder.mass / (std::numbers::pi * r * r * h), 1, 1e-4);
  EXPECT_NEAR(cylinder.centre.z(), h / 2, 1e-9);
  EXPECT_NEAR(cylinder.inertia(2, 2) / (cylinder.mass * r * r / 2), 1, 1e-4);
  EXPECT_NEAR(cylinder.inertia(0, 0) / (cylinder.mass * (3 * r * r + h * h) / 12), 1, 1e-4);

  const MassProperties cone = Integrate(assets::Lathe({{0, 0, 1}, {r, 0, 1}, {0, h, 0}}, 400));
  EXPECT_NEAR(cone.mass / (std::numbers::pi * r * r * h / 3), 1, 1e-4);
  EXPECT_NEAR(cone.centre.z(), h / 4, 1e-9);
  EXPECT_NEAR(cone.inertia(2, 2) / (0.3 * cone.mass * r * r), 1, 1e-4);
  EXPECT_NEAR(cone.inertia(0, 0) / (cone.mass * (0.15 * r * r + 0.0375 * h * h)), 1, 1e-4);
}

TEST(Integrate, TurnsMovesAndGrowsWithItsBody) {
  Rng rng(2);
  for (int round = 0; round < 30; ++round) {
    const assets::Mesh body = *ConvexHull(NormalPoints(12, rng));
    const Matrix3d R = Eigen::Quaterniond(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal()).normalized().matrix();
    const Vector3d by = NormalVector(rng);
    const double scale = rng.Uniform(0.2, 3);
    assets::Mesh moved = body;
    for (Vector3d& p : moved.positions) p = scale * (R * p) + by;

    const MassProperties before = Integrate(body), after = Integrate(moved);
    const double volume = std::pow(scale, 3);
    EXPECT_NEAR(after.mass, volume * before.mass, 1e-9 * after.mass);
    EXPECT_LT((after.centre - (scale * (R * before.centre) + by)).norm(), 1e-9);
    const Matrix3d expected = volume * scale * scale * (R * before.inertia * R.transpose());
    EXPECT_LT((after.inertia - expected).norm(), 1e-9 * expected.norm());
  }
}

TEST(Integrate, ABodyWoundInwardsIsAHole) {
  assets::Mesh shell = Box({0.5, 0.5, 0.5}, {0.1, 0, 0});
  assets::Mesh inner = Box({0.4, 0.4, 0.4}, {0.1, 0, 0});
  for (auto& face : inner.faces) std::swap(face[0], face[1]);
  EXPECT_NEAR(Integrate(inner).mass, -0.512, 1e-12);
  shell.Append(inner);
  EXPECT_TRUE(IsWatertight(shell));
  EXPECT_EQ(CountParts(shell), 2);
  const MassProperties hollow = Integrate(shell);
  EXPECT_NEAR(hollow.mass, 1 - 0.512, 1e-12);
  EXPECT_LT((hollow.centre - Vector3d(0.1, 0, 0)).norm(), 1e-12);
  EXPECT_NEAR(hollow.inertia(1, 1), (1 - 0.512 * 0.64) / 6, 1e-12);
}

TEST(Integrate, OfNothingIsNothing) {
  assets::Mesh flat;
  flat.AddPolygon({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}}, {{0, 0}, {1, 0}, {1, 1}});
  for (const MassProperties& nothing : {Integrate({}), Integrate(flat), Sum({}), Sum({Integrate(flat)})}) {
    EXPECT_EQ(nothing.mass, 0);
    EXPECT_EQ(nothing.centre, Vector3d::Zero()) << "nowhere, but not undefined";
    EXPECT_EQ(nothing.inertia, Matrix3d::Zero());
  }
}

TEST(Sum, OfRandomPartsIsTheirUnion) {
  Rng rng(3);
  for (int round = 0; round < 20; ++round) {
    assets::Mesh both = *ConvexHull(NormalPoints(10, rng)), part = *ConvexHull(NormalPoints(10, rng));
    const MassProperties sum = Sum({Integrate(both), Integrate(part)});
    both.Append(part);
    const MassProperties whole = Integrate(both);
    EXPECT_NEAR(sum.mass, whole.mass, 1e-9);
    EXPECT_LT((sum.centre - whole.centre).norm(), 1e-9);
    EXPECT_LT((sum.inertia - whole.inertia).norm(), 1e-9);
  }
}

TEST(Sum, OfTwoHalvesIsTheWhole) {
  const MassProperties whole = Integrate(Box({0.2, 0.1, 0.1}, {0.2, 0, 0}));
  const MassProperties sum =
      Sum({Integrate(Box({0.1, 0.1, 0.1}, {0.1, 0, 0})), Integrate(Box({0.1, 0.1, 0.1}, {0.3, 0, 0}))});

  EXPECT_NEAR(sum.mass, whole.mass, 1e-12);
  EXPECT_LT((sum.centre - whole.centre).norm(), 1e-12);
  EXPECT_LT((sum.inertia - whole.inertia).norm(), 1e-12);
}

TEST(Diagonalise, GivesBackTheInertia) {
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized()));
  const Eigen::Matrix3d R = turn.toRotationMatrix();
  const Eigen::Matrix3d inertia = R * Vector3d(1, 2, 2.5).asDiagonal() * R.transpose();

  const PrincipalInertia principal = Diagonalise(inertia);
  const Eigen::Matrix3d A = principal.axes.toRotationMatrix();
  EXPECT_LT((A * principal.moments.asDiagonal() * A.transpose() - inertia).norm(), 1e-12);
}

TEST(Diagonalise, GivesRightHandedAxesAndMomentsThatABodyCanHave) {
  Rng rng(4);
  for (int round = 0; round < 50; ++round) {
    const Matrix3d inertia = Integrate(*ConvexHull(NormalPoints(8, rng))).inertia;
    const PrincipalInertia principal = Diagonalise(inertia);
    const Vector3d& moments = principal.moments;
    EXPECT_TRUE(0 < moments[0] && moments[0] <= moments[1] && moments[1] <= moments[2]);
    EXPECT_LE(moments[2], moments[0] + moments[1] + 1e-12) << "the triangle inequality of a solid";
    const Matrix3d A = principal.axes.toRotationMatrix();
    EXPECT_NEAR(A.determinant(), 1, 1e-9);
    EXPECT_LT((A * moments.asDiagonal() * A.transpose() - inertia).norm(), 1e-9 * inertia.norm());
  }
}

TEST(SmallestFace, IsTheSmallestAreaOfAll) {
  assets::Mesh mesh = Box({1, 2, 3}, {0, 0, 0});
  EXPECT_NEAR(SmallestFace(mesh), 4, 1e-12) << "half of 2 by 4";
  mesh.AddPolygon({{0, 0, 0}, {0.1, 0, 0}, {0, 0.1, 0}}, {{0, 0}, {1, 0}, {0, 1}});
  EXPECT_NEAR(SmallestFace(mesh), 0.005, 1e-12);
  EXPECT_EQ(SmallestFace({}), 0);
}

TEST(ComputeNormals, OfASphereAreItsRadii) {
  Rng rng(5);
  std::vector<Vector3d> points = NormalPoints(400, rng);
  for (Vector3d& p : points) p.normalize();
  assets::Mesh sphere = *ConvexHull(points);
  sphere.normals.clear();
  ComputeNormals(sphere);
  ASSERT_EQ(sphere.normals.size(), sphere.positions.size());
  for (std::size_t i = 0; i < sphere.normals.size(); ++i) {
    EXPECT_NEAR(sphere.normals[i].norm(), 1, 1e-12);
    EXPECT_GT(sphere.normals[i].dot(sphere.positions[i]), 0.97);
  }
}

TEST(IsWatertight, SeesAMissingAndATurnedFace) {
  const assets::Mesh box = Box({1, 1, 1}, {0, 0, 0});
  EXPECT_TRUE(IsWatertight(box));
  EXPECT_EQ(CountParts(box), 1);

  assets::Mesh open = box;
  open.faces.pop_back();
  EXPECT_FALSE(IsWatertight(open));

  assets::Mesh turned = box;
  std::swap(turned.faces[0][0], turned.faces[0][1]);
  EXPECT_FALSE(IsWatertight(turned));

  assets::Mesh two = box;
  two.Append(Box({1, 1, 1}, {5, 0, 0}));
  EXPECT_TRUE(IsWatertight(two));
  EXPECT_EQ(CountParts(two), 2);
}

}  // namespace mass_test
}  // namespace etude::synthesis
