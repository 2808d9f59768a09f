// SPDX-License-Identifier: Apache-2.0
// Velocity dampers between bodies of the arm: the nearer two of them are, the slower they may come nearer.
//
// Source: Faverjon & Tournassoud 1987, "A local based approach for path planning of manipulators with a high number of
// degrees of freedom", IEEE Int. Conf. on Robotics and Automation.
#pragma once

#include <Eigen/Core>

#include "worker/collide/checker.h"

namespace etude::task {

/// Joint velocities (n, rad/s) v with slopes * v >= least, a row for each pair of bodies.
struct VelocityDampers {
  Eigen::MatrixXd slopes;  ///< (rows, n) m/rad, of the distance by the joints
  Eigen::VectorXd least;   ///< (rows) m/s, 0 or less

  bool empty() const { return least.size() == 0; }
  bool Allow(const Eigen::VectorXd& v) const { return empty() || (slopes * v - least).minCoeff() >= 0; }
};

/// Of the arm's bodies at q that are apart at home (collide::PairSet::kSelfApart) and nearer than 6 cm: they may come
/// nearer by eight times a second what they are apart beyond 5 mm, and below 5 mm not at all.
/// @param gripper  0 open .. 1 closed
VelocityDampers SelfDampers(collide::Checker& checker, sim::Kinematics& kinematics, const Eigen::VectorXd& q,
                            double gripper);

/// The joint velocity nearest to `v` (least squares) that `dampers` allow: exact where one of them is at its bound;
/// where several are, as near as 50 rounds come (two that all but oppose each other may be missed by more than a
/// little).
Eigen::VectorXd Damped(const Eigen::VectorXd& v, const VelocityDampers& dampers);

}  // namespace etude::task
