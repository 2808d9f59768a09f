// SPDX-License-Identifier: Apache-2.0
#include "services/episode/pose.h"

#include <algorithm>
#include <cmath>

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

Pose Interpolate(const Pose& a, const Pose& b, double part) { return {a.p + part * (b.p - a.p), a.q.slerp(part, b.q)}; }

double AngleBetween(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) { return a.angularDistance(b); }

}  // namespace etude
