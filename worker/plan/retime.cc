// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/retime.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "worker/plan/line_motion.h"
#include "worker/plan/speed_profile.h"

namespace etude::plan::internal {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr double kGridSpacing = 0.01;  ///< rad
constexpr double kLongest = 60;        ///< s
/// Joints may reach their speed limit in 1/8 s. Only an arm that turns on the spot meets this one.
constexpr double kJointAccelPerSpeed = 8;

// Limits along the curve at one grid point, in its parameter u.
struct Bound {
  double rate2 = 0;  ///< largest squared rate of u
  double accel = 0;  ///< largest second derivative of u at that rate
};

struct Measure {
  double first = 0, second = 0;  ///< size of d/du and d2/du2 of a quantity
  double speed = 0, accel = 0;   ///< its limits
};

Bound BoundOf(std::initializer_list<Measure> measures) {
  constexpr double kTiny = 1e-9;
  Bound bound{std::numeric_limits<double>::max(), std::numeric_limits<double>::max()};
  for (const Measure& m : measures) {
    if (m.first > kTiny) bound.rate2 = std::min(bound.rate2, std::pow(m.speed / m.first, 2));
    if (m.second > kTiny) bound.rate2 = std::min(bound.rate2, m.accel / (2 * m.second));
  }
  for (const Measure& m : measures)
    if (m.first > kTiny) bound.accel = std::min(bound.accel, (m.accel - m.second * bound.rate2) / m.first);
  return bound;
}

std::vector<Bound> Bounds(const JointCurve& curve, sim::Kinematics& kinematics, const Limits& limits, int grid) {
  std::vector<JointCurve::State> states;
  std::vector<Vector6> twists;  // of the tool per unit of u
  for (int i = 0; i <= grid; ++i) {
    states.push_back(curve.At(static_cast<double>(i) / grid));
    twists.push_back(kinematics.Jacobian(states[i].q) * states[i].dq);
  }
  std::vector<Bound> bounds;
  for (int i = 0; i <= grid; ++i) {
    const int before = std::max(0, i - 1), after = std::min(grid, i + 1);
    const Vector6 bend = (twists[after] - twists[before]) * (static_cast<double>(grid) / (after - before));
    bounds.push_back(BoundOf({{twists[i].head<3>().norm(), bend.head<3>().norm(), limits.linear, limits.linear_accel},
                              {twists[i].tail<3>().norm(), bend.tail<3>().norm(), limits.angular, limits.angular_accel},
                              {states[i].dq.cwiseAbs().maxCoeff(), states[i].ddq.cwiseAbs().maxCoeff(), limits.joint,
                               kJointAccelPerSpeed * limits.joint}}));
  }
  return bounds;
}

// Squared rates at the grid points: forward from the start's, backward from rest.
std::vector<double> Passes(const std::vector<Bound>& bounds, double start_rate) {
  const int grid = static_cast<int>(bounds.size()) - 1;
  const double du = 1.0 / grid;
  std::vector<double> rate2;
  for (const Bound& bound : bounds) rate2.push_back(bound.rate2);
  rate2.front() = std::min(rate2.front(), start_rate * start_rate);
  rate2.back() = 0;
  const auto gain = [&](int i) { return 2 * du * std::min(bounds[i].accel, bounds[i + 1].accel); };
  for (int i = 0; i < grid; ++i) rate2[i + 1] = std::min(rate2[i + 1], rate2[i] + gain(i));
  for (int i = grid - 1; i >= 0; --i) rate2[i] = std::min(rate2[i], rate2[i + 1] + gain(i));
  return rate2;
}

// The curve's parameter over time, piecewise with constant second derivative.
struct Schedule {
  std::vector<double> rate2, time;

  SpeedProfile::State At(double t) const {
    const int grid = static_cast<int>(time.size()) - 1;
    const auto next = std::upper_bound(time.begin(), time.end(), t);
    const int i = std::clamp(static_cast<int>(next - time.begin()) - 1, 0, grid - 1);
    const double rate = std::sqrt(rate2[i]), accel = (rate2[i + 1] - rate2[i]) * grid / 2;
    const double passed = std::min(t - time[i], time[i + 1] - time[i]);
    return {static_cast<double>(i) / grid + passed * (rate + accel * passed / 2), rate + accel * passed};
  }
};

Schedule MakeSchedule(std::vector<double> rate2) {
  const int grid = static_cast<int>(rate2.size()) - 1;
  Schedule schedule{std::move(rate2), {0}};
  for (int i = 0; i < grid; ++i) {
    const double sum = std::sqrt(schedule.rate2[i]) + std::sqrt(schedule.rate2[i + 1]);
    schedule.time.push_back(schedule.time[i] + 2.0 / grid / sum);
  }
  return schedule;
}

}  // namespace

std::optional<Motion> Retime(const JointCurve& curve, sim::Kinematics& kinematics, const Limits& limits,
                             double start_speed, const Pose& X_WE_goal) {
  const int grid = std::max(32, static_cast<int>(std::ceil(curve.length() / kGridSpacing)));
  const std::vector<Bound> bounds = Bounds(curve, kinematics, limits, grid);
  const JointCurve::State start = curve.At(0);
  const double start_twist = (kinematics.Jacobian(start.q) * start.dq).head<3>().norm();
  const Schedule schedule = MakeSchedule(Passes(bounds, start_twist > 1e-9 ? start_speed / start_twist : 0));
  const double duration = schedule.time.back();
  if (!(duration < kLongest)) return std::nullopt;

  // stretched to a whole number of control steps; what the end misses of the goal is spread along u
  const int steps = WholePeriods(duration, 1 / kControlRate);
  const double pace = duration * kControlRate / steps;
  const ToolLine correction(Pose{}, kinematics.X_WE(curve.At(1).q).inverse() * X_WE_goal);
  Motion motion;
  for (int step = 0; step < steps; ++step) {
    const SpeedProfile::State at = schedule.At(pace * step / kControlRate);
    const JointCurve::State state = curve.At(at.s);
    motion.X_WE.push_back(kinematics.X_WE(state.q) * correction.At(std::min(at.s, 1.0)));
    motion.V_WE.push_back(kinematics.Jacobian(state.q) * state.dq * (at.ds * pace));
  }
  motion.X_WE.push_back(X_WE_goal);
  motion.V_WE.push_back(Vector6::Zero());
  return motion;
}

}  // namespace etude::plan::internal
