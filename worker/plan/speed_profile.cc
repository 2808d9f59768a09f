// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/speed_profile.h"

#include <algorithm>
#include <cmath>

#include "services/core/check.h"

namespace etude::plan::internal {

int WholePeriods(double duration, double period) {
  return std::max(1, static_cast<int>(std::ceil(duration / period - 1e-9)));
}

SpeedProfile::SpeedProfile(double length, double start_speed, double max_speed, double accel, double period)
    : length_(length),
      start_speed_(std::min(start_speed, 2 * std::sqrt(accel * length))),
      accel_(accel),
      period_(period) {
  ETUDE_CHECK(length > 0 && start_speed >= 0 && max_speed > 0 && accel > 0,
              "length={} start_speed={} max_speed={} accel={}", length, start_speed, max_speed, accel);
  const double v0 = start_speed_;
  const double braking = v0 * v0 / (2 * accel);  // length that stopping at once takes
  if (braking >= length) {
    steps_ = WholePeriods(2 * length / v0, period);
    duration_ = steps_ * period;
    return;
  }

  // shortest duration, then the cruise speed that makes it a whole number of periods
  const double fastest = std::min(max_speed, std::sqrt(accel * length + v0 * v0 / 2));
  const double shortest =
      fastest >= v0 ? (fastest - v0) / accel + (length + braking) / fastest : v0 / accel + (length - braking) / fastest;
  steps_ = WholePeriods(shortest, period);
  duration_ = steps_ * period;
  const double half_sum = (duration_ + v0 / accel) / 2;
  const double root = half_sum * half_sum - (length + braking) / accel;
  cruise_ = accel * (half_sum - std::sqrt(std::max(0.0, root)));
  if (cruise_ < v0) cruise_ = (length - braking) / (duration_ - v0 / accel);
}

SpeedProfile::State SpeedProfile::At(int step) const {
  if (step >= steps_) return {length_, 0};
  const double t = step * period_, v0 = start_speed_;
  if (cruise_ == 0) {
    // cubic with the ends' values and rates
    const double x = t / duration_;
    const double from = v0 * duration_;
    return {x * (from + x * (3 * length_ - 2 * from + x * (from - 2 * length_))),
            (from + x * (2 * (3 * length_ - 2 * from) + x * 3 * (from - 2 * length_))) / duration_};
  }

  const double accel = cruise_ >= v0 ? accel_ : -accel_;
  const double t_cruise = (cruise_ - v0) / accel, t_brake = duration_ - cruise_ / accel_;
  if (t < t_cruise) return {t * (v0 + accel * t / 2), v0 + accel * t};
  const double left = duration_ - t;
  if (t > t_brake) return {length_ - accel_ * left * left / 2, accel_ * left};
  const double s_cruise = t_cruise * (v0 + cruise_) / 2;
  return {s_cruise + cruise_ * (t - t_cruise), cruise_};
}

}  // namespace etude::plan::internal
