// SPDX-License-Identifier: Apache-2.0
// Where time goes.
#pragma once

#include "services/core/clock.h"

namespace etude::plan {

/// Adds the seconds from its construction to its end to a sum.
class Timer {
 public:
  explicit Timer(double& sum) : sum_(sum) {}
  ~Timer() { sum_ += watch_.Seconds(); }
  Timer(const Timer&) = delete;
  Timer& operator=(const Timer&) = delete;

 private:
  double& sum_;
  Stopwatch watch_;
};

}  // namespace etude::plan
