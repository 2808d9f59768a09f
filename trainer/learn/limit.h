// SPDX-License-Identifier: Apache-2.0
// When a run ends, and how far it is. Steps decide. Minutes are how people ask: they become steps once, when enough
// steps have been measured with every module in training, and from then on the clock has no say, so that learning
// rate and curriculum of a run depend on its steps and can be had again.
#pragma once

#include <cstdint>

#include "services/core/config.h"
#include "services/core/result.h"

namespace etude::learn {

/// Steps are measured over this many.
inline constexpr std::uint64_t kMeasuredSteps = 200;

/// Pure: time is told to it. Not thread-safe.
class RunLimit {
 public:
  /// @param steps    0: no limit by steps    @param minutes  of training; 0: no limit by time
  RunLimit(std::uint64_t steps, double minutes) : steps_(steps), asked_minutes_(minutes), minutes_(minutes) {}

  /// Of the run, 0..1; never falls over a conversion.
  double Progress(std::uint64_t step, double elapsed_s) const;

  /// Tells of a finished step. @param whole  every module is in training: only then does a step cost what the rest
  /// of the run's steps will. @returns true when minutes have just become steps
  bool Observe(std::uint64_t step, double elapsed_s, bool whole);
  /// The run ended by time before it could be measured: it was as many steps as were done.
  void EndAt(std::uint64_t step);

  std::uint64_t steps() const { return steps_; }
  double minutes() const { return minutes_; }  ///< 0 once they are steps

  OrderedJson Save() const;
  /// Goes on with what an earlier run converted, unless another limit was asked for: the same minutes, or the steps
  /// that they became. @error kCorrupt: `saved` is not what Save gives; the limit is unchanged.
  Status Restore(const OrderedJson& saved);

 private:
  void Convert(std::uint64_t step, double progress, std::uint64_t steps);

  std::uint64_t steps_;
  double asked_minutes_, minutes_;
  // progress is a line from here to (steps_, 1)
  std::uint64_t anchor_step_ = 0;
  double anchor_progress_ = 0;
  // first of the steps that are measured
  bool measuring_ = false;
  std::uint64_t first_step_ = 0;
  double first_s_ = 0;
};

}  // namespace etude::learn
