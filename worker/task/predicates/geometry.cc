// SPDX-License-Identifier: Apache-2.0
#include "worker/task/predicates/geometry.h"

#include <algorithm>
#include <cmath>

#include "services/core/check.h"

namespace etude::task {

double TiltOf(const Pose& X_WO) { return std::acos(std::clamp((X_WO.q * Eigen::Vector3d::UnitZ()).z(), -1.0, 1.0)); }

double TurnError(const Pose& X_WO, const Pose& X_WO_start, double angle) {
  const Eigen::Vector3d euler = ToEuler(X_WO.q * X_WO_start.q.conjugate());
  const Eigen::Vector3d turned(angle, 0, 0);
  return std::min((euler - turned).norm(), (euler + turned).norm());
}

const std::vector<std::string>& Sides() {
  static const std::vector<std::string> sides{"left", "right", "front", "behind"};
  return sides;
}

Eigen::Vector3d DirectionOfSide(const std::string& side) {
  if (side == "left") return Eigen::Vector3d::UnitX();
  if (side == "right") return -Eigen::Vector3d::UnitX();
  if (side == "front") return Eigen::Vector3d::UnitY();
  ETUDE_CHECK(side == "behind", "side={}", side);
  return -Eigen::Vector3d::UnitY();
}

bool IsOnSide(const std::string& side, const Eigen::Vector3d& p_WO, const Eigen::Vector3d& p_WR,
              const BesideBounds& bounds) {
  const Eigen::Vector3d direction = DirectionOfSide(side);
  Eigen::Vector3d d = p_WO - p_WR;
  d.z() = 0;
  const double along = d.dot(direction);
  return along > bounds.near && along < bounds.far && (d - along * direction).norm() < bounds.aside;
}

double HalfHeight(const Eigen::Vector3d& half_extent, const Eigen::Quaterniond& q_WO) {
  return q_WO.toRotationMatrix().row(2).cwiseAbs().dot(half_extent);
}

}  // namespace etude::task
