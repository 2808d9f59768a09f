// SPDX-License-Identifier: Apache-2.0
// A smooth curve in joint space that follows a polyline.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace etude::plan::internal {

/// Uniform cubic B-spline, twice continuously differentiable, through the first and the last point
/// of a polyline; it leaves the polyline at corners by less than `spacing`.
class JointCurve {
 public:
  struct State {
    Eigen::VectorXd q, dq, ddq;  ///< and derivatives by u
  };

  /// @param polyline  at least 2 points   @param spacing  rad between control points, > 0
  JointCurve(const std::vector<Eigen::VectorXd>& polyline, double spacing);

  State At(double u) const;                  ///< u in [0, 1]
  double length() const { return length_; }  ///< rad, of the polyline

 private:
  double length_ = 0;
  std::vector<Eigen::VectorXd> controls_;  ///< with one beyond each end
};

}  // namespace etude::plan::internal
