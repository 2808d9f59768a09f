// SPDX-License-Identifier: Apache-2.0
// Tests worker/synthesis/mass.cc
#include "worker/synthesis/mass.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace etude::synthesis {
namespace {

using Eigen::Vector3d;

assets::Mesh Box(const Vector3d& half, const Vector3d& centre) {
  assets::Mesh mesh = assets::Extrude(
      {{-half.x(), -half.z()}, {half.x(), -half.z()}, {half.x(), half.z()}, {-half.x(), half.z()}}, half.y(), false);
  for (Vector3d& p : mesh.positions) p += centre;
  return mesh;
}

assets::Mesh Sphere(double radius, int rings) {
  std::vector<assets::ProfilePoint> profile;
  for (int i = 0; i <= rings; ++i) {
    const double angle = std::numbers::pi * i / rings;
    profile.push_back({i % rings == 0 ? 0 : radius * std::sin(angle), -radius * std::cos(angle), 0});
  }
  return assets::Lathe(profile, 2 * rings);
}

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

}  // namespace
}  // namespace etude::synthesis
