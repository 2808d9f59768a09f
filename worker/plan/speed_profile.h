// SPDX-License-Identifier: Apache-2.0
// One path parameter over time: from a speed, up or down to a cruise speed, to rest at the end.
#pragma once

namespace etude::plan::internal {

/// Trapezoid over [0, length] whose duration is a whole number of periods: the cruise speed is
/// lowered until it is. Units are those of `length`.
class SpeedProfile {
 public:
  struct State {
    double s = 0, ds = 0;  ///< parameter and its rate
  };

  /// @param start_speed  >= 0; lowered to what stops within `length` at twice `accel`
  SpeedProfile(double length, double start_speed, double max_speed, double accel, double period);

  int steps() const { return steps_; }  ///< periods from start to rest
  State At(int step) const;             ///< 0 .. steps()

 private:
  double length_, start_speed_, accel_, period_;
  double cruise_ = 0;  ///< 0: no cruise, a cubic from start_speed to rest
  double duration_ = 0;
  int steps_ = 0;
};

/// The least whole number of periods that is not shorter than `duration`.
int WholePeriods(double duration, double period);

}  // namespace etude::plan::internal
