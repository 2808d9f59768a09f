// SPDX-License-Identifier: Apache-2.0
#include "services/episode/pose.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace etude {

Eigen::Quaterniond FromEuler(const Eigen::Vector3d& rpy) {
  return Eigen::AngleAxisd(rpy.x(), Eigen::Vector3d::UnitX()) * Eigen::AngleAxisd(rpy.y(), Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(rpy.z(), Eigen::Vector3d::UnitZ());
}

Eigen::Vector3d ToEuler(const Eigen::Quaterniond& q) {
  // R = Rx Ry Rz: R(0,2) = sin(pitch), R(1,2) = -sin(roll) cos(pitch), R(0,1) = -cos(pitch) sin(yaw)
  const Eigen::Matrix3d R = q.toRotationMatrix();
  const double pitch = std::asin(std::clamp(R(0, 2), -1.0, 1.0));
  return {std::atan2(-R(1, 2), R(2, 2)), pitch, std::atan2(-R(0, 1), R(0, 0))};
}

Rotation6D ToRotation6D(const Eigen::Quaterniond& q) {
  const Eigen::Matrix3d R = q.toRotationMatrix();
  return {R(0, 0), R(1, 0), R(2, 0), R(0, 1), R(1, 1), R(2, 1)};
}

Eigen::Quaterniond FromRotation6D(const Rotation6D& columns) {
  constexpr double kTiny = 1e-6;  // of the second column's part at right angles to the first
  const Eigen::Vector3d first = Eigen::Vector3d::Map(columns.data());
  const Eigen::Vector3d second = Eigen::Vector3d::Map(columns.data() + 3);
  const Eigen::Vector3d x = first / first.norm();
  const Eigen::Vector3d across = second - x.dot(second) * x;
  // written so that NaN fails too
  if (!(first.norm() > kTiny && across.norm() > kTiny * std::max(1.0, second.norm()) && across.allFinite())) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    return {nan, nan, nan, nan};
  }
  Eigen::Matrix3d R;
  R.col(0) = x;
  R.col(1) = across.normalized();
  R.col(2) = x.cross(R.col(1));
  return Eigen::Quaterniond(R);
}

Pose Interpolate(const Pose& a, const Pose& b, double part) { return {a.p + part * (b.p - a.p), a.q.slerp(part, b.q)}; }

double AngleBetween(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) { return a.angularDistance(b); }

}  // namespace etude
