// SPDX-License-Identifier: Apache-2.0
// The straight line of the tool: position along a segment, orientation along the shortest rotation.
#pragma once

#include <vector>

#include "worker/plan/planner.h"

namespace etude::plan::internal {

class ToolLine {
 public:
  ToolLine(const Pose& X_WE_start, const Pose& X_WE_goal);

  double length() const { return p_SG_W_.norm(); }  ///< m
  double angle() const { return angle_; }           ///< rad
  bool is_point() const;                            ///< start and goal are the same
  Pose At(double s) const;                          ///< s in [0, 1]; At(1) is the goal itself
  /// Velocity of the tool when s changes by ds per second.
  Eigen::Matrix<double, 6, 1> Velocity(double ds) const;

 private:
  Pose X_WS_, X_WG_;
  Eigen::Vector3d p_SG_W_, axis_W_;
  double angle_ = 0;
};

/// A motion along a line, and where on it each sample is.
struct LineMotion {
  Motion motion;
  std::vector<double> s, ds;
};
LineMotion MoveAlong(const ToolLine& line, const Limits& limits, double start_speed);

}  // namespace etude::plan::internal
