// SPDX-License-Identifier: Apache-2.0
// Signed distance of two convex shapes with witness points.
#pragma once

#include "worker/collide/narrowphase.h"

namespace etude::collide {

/// How two shapes lie to each other.
struct Separation {
  double distance = 0;     ///< m; negative when they overlap: then moving A by -distance along `normal` parts them
  Eigen::Vector3d p_WA;    ///< m, nearest (deepest, when they overlap) point of A
  Eigen::Vector3d p_WB;    ///< and of B; p_WA - p_WB = distance * normal
  Eigen::Vector3d normal;  ///< unit, world, from B to A
};
/// Distance with witness points. Deterministic, and defined for every pose: where FCL's answer does not hold (it
/// fails its own certificate, or it throws), another one that does is returned. Distances are right to 1e-5 m; the
/// depth of an overlap is an upper bound of the least one, tight for the shapes' own face normals.
Separation Separate(const Shape& a, const Eigen::Isometry3d& X_WA, const Shape& b, const Eigen::Isometry3d& X_WB);
/// The same distance in m, 0 when the shapes share a point.
double Distance(const Shape& a, const Eigen::Isometry3d& X_WA, const Shape& b, const Eigen::Isometry3d& X_WB);

}  // namespace etude::collide
