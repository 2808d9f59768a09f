// SPDX-License-Identifier: Apache-2.0
// Convex shapes and the two exact tests on a pair of them. Hides FCL from the rest of the folder.
#pragma once

#include <Eigen/Geometry>
#include <memory>

#include "worker/sim/scene.h"

namespace etude::collide {

/// An immutable convex shape in its own frame G; a cheap handle.
class Shape {
 public:
  /// `geometry` grown by `inflation` (m). Contains every point within `inflation` of the original.
  /// Not for kConvex with inflation > 0.
  Shape(const sim::Geometry& geometry, double inflation);

  struct Fcl;
  const Fcl& fcl() const { return *fcl_; }

 private:
  std::shared_ptr<const Fcl> fcl_;
};

/// True when the shapes share a point. Deterministic.
bool Touch(const Shape& a, const Eigen::Isometry3d& X_WA, const Shape& b, const Eigen::Isometry3d& X_WB);
/// Distance in m, 0 when they share a point.
double Distance(const Shape& a, const Eigen::Isometry3d& X_WA, const Shape& b, const Eigen::Isometry3d& X_WB);

}  // namespace etude::collide
