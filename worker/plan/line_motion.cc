// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/line_motion.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "worker/plan/speed_profile.h"

namespace etude::plan {
namespace internal {
namespace {

constexpr double kPoint = 1e-7;  ///< m or rad; less is no motion

// Largest rate of the common parameter within a linear and an angular limit.
double Rate(const ToolLine& line, double linear, double angular) {
  double rate = std::numeric_limits<double>::infinity();
  if (line.length() > kPoint) rate = linear / line.length();
  if (line.angle() > kPoint) rate = std::min(rate, angular / line.angle());
  return rate;
}

}  // namespace

ToolLine::ToolLine(const Pose& X_WE_start, const Pose& X_WE_goal)
    : X_WS_(X_WE_start), X_WG_(X_WE_goal), p_SG_W_(X_WE_goal.p - X_WE_start.p), axis_W_(Eigen::Vector3d::UnitX()) {
  Eigen::Quaterniond turn = X_WG_.q * X_WS_.q.conjugate();
  if (turn.w() < 0) turn.coeffs() *= -1;
  const double sine = turn.vec().norm();
  angle_ = 2 * std::atan2(sine, turn.w());
  if (sine > 1e-12) axis_W_ = turn.vec() / sine;
}

bool ToolLine::is_point() const { return length() <= kPoint && angle_ <= kPoint; }

Pose ToolLine::At(double s) const {
  if (s >= 1) return X_WG_;
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(angle_ * s, axis_W_));
  return {X_WS_.p + p_SG_W_ * s, (turn * X_WS_.q).normalized()};
}

Eigen::Matrix<double, 6, 1> ToolLine::Velocity(double ds) const {
  Eigen::Matrix<double, 6, 1> V_WE;
  V_WE << p_SG_W_ * ds, axis_W_ * (angle_ * ds);
  return V_WE;
}

LineMotion MoveAlong(const ToolLine& line, const Limits& limits, double start_speed) {
  LineMotion result;
  const auto add = [&](double s, double ds) {
    result.motion.X_WE.push_back(line.At(s));
    result.motion.V_WE.push_back(line.Velocity(ds));
    result.s.push_back(s);
    result.ds.push_back(ds);
  };
  if (line.is_point()) {
    add(1, 0);
    return result;
  }

  double start_rate = line.length() > kPoint ? start_speed / line.length() : 0;
  if (line.angle() > kPoint) start_rate = std::min(start_rate, limits.angular / line.angle());
  const SpeedProfile profile(1, start_rate, Rate(line, limits.linear, limits.angular),
                             Rate(line, limits.linear_accel, limits.angular_accel), 1 / kControlRate);
  for (int step = 0; step <= profile.steps(); ++step) {
    const SpeedProfile::State state = profile.At(step);
    add(state.s, state.ds);
  }
  return result;
}

}  // namespace internal

Motion StraightMotion(const Pose& X_WE_start, const Pose& X_WE_goal, const Limits& limits, double start_speed) {
  const internal::ToolLine line(X_WE_start, X_WE_goal);
  return internal::MoveAlong(line, limits, start_speed).motion;
}

}  // namespace etude::plan
