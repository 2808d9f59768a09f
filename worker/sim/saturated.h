// SPDX-License-Identifier: Apache-2.0
// Vectors that are no longer than a limit.
#pragma once

#include <Eigen/Core>

namespace etude::sim {

/// `v`, no longer than `limit`, in its direction. @pre limit >= 0
inline Eigen::Vector3d Saturated(const Eigen::Vector3d& v, double limit) {
  const double norm = v.norm();
  return norm > limit ? Eigen::Vector3d(v * (limit / norm)) : v;
}

}  // namespace etude::sim
