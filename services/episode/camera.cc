// SPDX-License-Identifier: Apache-2.0
#include "services/episode/camera.h"

#include <cmath>
#include <limits>

namespace etude {

double Camera::focal() const { return 0.5 * height / std::tan(0.5 * fovy); }

Eigen::Vector2d Camera::Project(const Eigen::Vector3d& p_W) const {
  const Eigen::Vector3d p_C = X_WC.inverse() * p_W;
  const double depth = -p_C.z();
  if (depth <= 0) return Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
  return {0.5 * width + focal() * p_C.x() / depth, 0.5 * height - focal() * p_C.y() / depth};
}

}  // namespace etude
