// SPDX-License-Identifier: Apache-2.0
// Poses and rotations. Monogram notation: X_WE is the pose of E (end-effector) in W (world), p_WE its
// position (m), R_WE its rotation; X_AB * X_BC = X_AC.
#pragma once

#include <Eigen/Geometry>
#include <array>

namespace etude {

/// A rigid transform. Value type.
struct Pose {
  Eigen::Vector3d p = Eigen::Vector3d::Zero();            ///< m
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();  ///< unit

  Pose operator*(const Pose& other) const { return {p + q * other.p, (q * other.q).normalized()}; }
  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const { return p + q * point; }
  Pose inverse() const { return {q.conjugate() * -p, q.conjugate()}; }
};

/// Euler angles "rxyz" (intrinsic x-y-z): R = Rx(roll) Ry(pitch) Rz(yaw), rad. This is the convention
/// of the original's recorded orientations and of MuJoCo's default eulerseq.
Eigen::Quaterniond FromEuler(const Eigen::Vector3d& roll_pitch_yaw);
/// Inverse of FromEuler; roll and yaw in (-pi, pi], pitch in [-pi/2, pi/2].
Eigen::Vector3d ToEuler(const Eigen::Quaterniond& q);

/// A rotation as the first two columns of its matrix, one after the other: r1x, r1y, r1z, r2x, r2y, r2z. Continuous
/// everywhere, which Euler angles and quaternions are not (Zhou et al., "On the Continuity of Rotation
/// Representations in Neural Networks", CVPR 2019): a small turn is a small change of these numbers, always.
using Rotation6D = std::array<double, 6>;
Rotation6D ToRotation6D(const Eigen::Quaterniond& q);
/// Inverse of ToRotation6D by Gram-Schmidt: the columns need be neither of length 1 nor at right angles (a network
/// says them). Coefficients are NaN when the columns are not finite, nearly zero or nearly parallel.
Eigen::Quaterniond FromRotation6D(const Rotation6D& columns);

/// Part 0 .. 1 of the straight way from a to b: straight in position, at an even turn by the shortest rotation.
Pose Interpolate(const Pose& a, const Pose& b, double part);

/// Angle of the rotation from a to b, rad, in [0, pi].
double AngleBetween(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b);

}  // namespace etude
