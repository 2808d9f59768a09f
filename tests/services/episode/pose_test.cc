// SPDX-License-Identifier: Apache-2.0
// Tests services/episode/pose.cc
#include "services/episode/pose.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "services/core/rng.h"

namespace etude {
namespace pose_test {

Eigen::Vector3d RandomAngles(Rng& rng) {
  return {rng.Uniform(-3.1, 3.1), rng.Uniform(-1.5, 1.5), rng.Uniform(-3.1, 3.1)};
}

TEST(Pose, EulerAnglesComposeAsRotationsAboutXThenYThenZ) {
  Rng rng(1);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d a = RandomAngles(rng);
    Eigen::Matrix3d rx, ry, rz;
    rx << 1, 0, 0, 0, std::cos(a[0]), -std::sin(a[0]), 0, std::sin(a[0]), std::cos(a[0]);
    ry << std::cos(a[1]), 0, std::sin(a[1]), 0, 1, 0, -std::sin(a[1]), 0, std::cos(a[1]);
    rz << std::cos(a[2]), -std::sin(a[2]), 0, std::sin(a[2]), std::cos(a[2]), 0, 0, 0, 1;

    const Eigen::Matrix3d R = FromEuler(a).toRotationMatrix();

    EXPECT_LT((R - rx * ry * rz).norm(), 1e-12);
    EXPECT_LT((ToEuler(FromEuler(a)) - a).norm(), 1e-9);
  }
}

TEST(Pose, ProductAndInverseAreThoseOfHomogeneousMatrices) {
  Rng rng(2);
  const auto matrix = [](const Pose& X) {
    Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
    m.topLeftCorner<3, 3>() = X.q.toRotationMatrix();
    m.topRightCorner<3, 1>() = X.p;
    return m;
  };
  for (int i = 0; i < 50; ++i) {
    const Pose X_AB{Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal()), FromEuler(RandomAngles(rng))};
    const Pose X_BC{Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal()), FromEuler(RandomAngles(rng))};

    EXPECT_LT((matrix(X_AB * X_BC) - matrix(X_AB) * matrix(X_BC)).norm(), 1e-12);
    EXPECT_LT((matrix(X_AB.inverse()) - matrix(X_AB).inverse()).norm(), 1e-12);
  }
}

TEST(Pose, AngleBetweenIsTheAngleOfTheRotation) {
  const Eigen::Quaterniond a = FromEuler({0.1, 0.2, 0.3});
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()));

  EXPECT_NEAR(AngleBetween(a, a * turn), 0.7, 1e-9);
  EXPECT_NEAR(AngleBetween(a, Eigen::Quaterniond(-a.coeffs())), 0, 1e-6);
}

TEST(Rotation6D, SurvivesAndNeedsNoUnitColumns) {
  Rng rng(3);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Quaterniond q = FromEuler(RandomAngles(rng));
    Rotation6D columns = ToRotation6D(q);
    EXPECT_LT(AngleBetween(FromRotation6D(columns), q), 1e-7);

    // longer columns, the second one leaning to the first: what a network may say
    for (int k = 0; k < 3; ++k) {
      columns[k] *= 3;
      columns[3 + k] = 0.5 * columns[3 + k] + 0.1 * columns[k];
    }
    EXPECT_LT(AngleBetween(FromRotation6D(columns), q), 1e-7);
  }
}

TEST(Rotation6D, IsContinuousWhereEulerAnglesJump) {
  // a hand that looks down: pitch 90 degrees, tilted by 3 mrad one way and the other
  const Eigen::Quaterniond down = FromEuler({0.4, M_PI / 2, 0.2});
  const auto tilt = [&](double angle) {
    return Eigen::Quaterniond(Eigen::AngleAxisd(angle, Eigen::Vector3d(0.3, 0.4, 0.5).normalized())) * down;
  };
  const Rotation6D a = ToRotation6D(tilt(-0.003)), b = ToRotation6D(tilt(0.003));
  double square = 0;
  for (int i = 0; i < 6; ++i) square += (a[i] - b[i]) * (a[i] - b[i]);

  EXPECT_GT((ToEuler(tilt(-0.003)) - ToEuler(tilt(0.003))).norm(), 1);
  EXPECT_LT(std::sqrt(square), 0.01);
}

TEST(Rotation6D, SaysNotANumberWhereNoRotationIs) {
  const double inf = std::numeric_limits<double>::infinity();
  for (const Rotation6D& none :
       {Rotation6D{}, Rotation6D{1, 0, 0, 0, 0, 0}, Rotation6D{1, 0, 0, -2, 0, 0}, Rotation6D{0, 0, 0, 0, 1, 0},
        Rotation6D{NAN, 0, 0, 0, 1, 0}, Rotation6D{1, 0, 0, 0, inf, 0}})
    EXPECT_FALSE(FromRotation6D(none).coeffs().allFinite()) << none[0] << none[3] << none[4];
}

TEST(Pose, InterpolatesStraightAndByTheShortestTurn) {
  const Pose a{{0, 0, 1}, FromEuler({0, 0, 0.2})};
  const Pose b{{2, -4, 1}, Eigen::Quaterniond(-FromEuler({0, 0, 1.2}).coeffs())};  // the same turn, other sign
  const Pose quarter = Interpolate(a, b, 0.25);
  EXPECT_LT((quarter.p - Eigen::Vector3d(0.5, -1, 1)).norm(), 1e-15);
  EXPECT_LT(AngleBetween(quarter.q, FromEuler({0, 0, 0.45})), 1e-7);
  EXPECT_LT(AngleBetween(Interpolate(a, b, 1).q, b.q), 1e-7);
}

}  // namespace pose_test
}  // namespace etude
