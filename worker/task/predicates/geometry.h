// SPDX-License-Identifier: Apache-2.0
// Measures that predicates and the goals of stages share.
#pragma once

#include <string>
#include <vector>

#include "services/episode/pose.h"

namespace etude::task {

/// Angle between the object's vertical axis and the world's, rad: 0 upright, pi/2 lying.
double TiltOf(const Pose& X_WO);

/// How far the object is from having been turned by `angle` (rad) about the world's x, the nearer way: the norm of the
/// Euler error (rxyz) of R_now R_start^T, rad. Source: the authors' criterion of "put down", with either sign.
double TurnError(const Pose& X_WO, const Pose& X_WO_start, double angle);

/// The sides of a thing as seen in the picture: left | right | front (towards the camera) | behind.
const std::vector<std::string>& Sides();
/// Their directions in W: left is +x, right -x, front +y, behind -y. @pre one of Sides()
Eigen::Vector3d DirectionOfSide(const std::string& side);

/// Where "beside" begins and ends, m.
struct BesideBounds {
  double near = 0.04;   ///< at least along the side's direction,
  double far = 0.20;    ///< at most,
  double aside = 0.05;  ///< and at most across it
};
/// True when p_WO lies on that side of p_WR, within the bounds, seen from above.
bool IsOnSide(const std::string& side, const Eigen::Vector3d& p_WO, const Eigen::Vector3d& p_WR,
              const BesideBounds& bounds = {});

/// Half the height of a box of `half_extent` that is turned by q_WO, m.
double HalfHeight(const Eigen::Vector3d& half_extent, const Eigen::Quaterniond& q_WO);

}  // namespace etude::task
