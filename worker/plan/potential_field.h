// SPDX-License-Identifier: Apache-2.0
// A motion that is drawn to its goal and driven off obstacles: Khatib's potential field, followed in small steps.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "worker/collide/checker.h"

namespace etude::plan::internal {

/// How far around bodies the field drives the arm off: rho_0 of each pair of bodies.
///
/// It is `clearance` for the obstacles that are named, less for the rest (the table, other objects). Where start or
/// goal are nearer than that, it is what they leave: it shrinks with the tool's way to them, so that the goal is where
/// the field ends, and leaving the start is no climb.
class Influence {
 public:
  struct Place {
    Eigen::VectorXd q;
    Pose X_WE;
  };
  /// @param obstacles  as in Request
  Influence(collide::Checker& checker, const Place& start, const Place& goal, double clearance,
            const std::vector<std::string>& obstacles);

  /// rho_0 of the pair while the tool is at X_WE, m.
  double Of(const collide::Proximity& pair, const Pose& X_WE) const;
  double largest() const { return std::max(clearance_, least_); }  ///< m
  /// Least part of rho_0 that is left at q, 1 where no influence is entered.
  double PartLeft(collide::Checker& checker, const Eigen::VectorXd& q, const Pose& X_WE) const;

 private:
  using Names = std::pair<std::string, std::string>;
  std::map<Names, double> NearerThan(collide::Checker& checker, const Eigen::VectorXd& q) const;

  double clearance_, least_;
  std::vector<std::string> obstacles_;
  Pose X_WE_start_, X_WE_goal_;
  std::map<Names, double> at_start_, at_goal_;  ///< distances
};

struct FieldProblem {
  Eigen::VectorXd q_start;
  Pose X_WE_goal;
  Eigen::VectorXd q_min, q_max;                         ///< rad
  const Influence* influence = nullptr;                 ///< borrowed
  std::function<bool(const Eigen::VectorXd&)> is_free;  ///< the flow never enters what is not
  /// What a redundant arm makes of a configuration while its controller follows the tool alone; empty: the same.
  std::function<Eigen::VectorXd(const Eigen::VectorXd&)> settle = nullptr;
};

struct FieldResult {
  std::vector<Eigen::VectorXd> path;  ///< from the start, steps of at most 0.05 rad
  bool reached = false;               ///< the goal
  std::string trap;                   ///< where and by what it is held, unless it reached the goal
  double keep = 1;                    ///< least part of rho_0 along the path
};

/// Source: Khatib 1986, "Real-Time Obstacle Avoidance for Manipulators and Mobile Robots", Int. J. Robotics Research
/// 5(1): attraction of the tool with bounded speed, repulsion of every body of the arm from its nearest points
/// (FIRAS function), repulsion from joint limits. As a flow of configurations instead of forces: each term sets the
/// speed of its own point, through the damped inverse of that point's Jacobian. A pure function of its arguments.
FieldResult FollowField(const FieldProblem& problem, sim::Kinematics& kinematics, collide::Checker& checker);

}  // namespace etude::plan::internal
