// SPDX-License-Identifier: Apache-2.0
// When a run ends, and how far it is. Steps decide. Minutes are how people ask: they become steps when enough of them
// have been measured with every module in training, and are looked at again at each quarter of the run and shortly
// before its end, where kMeasuredSteps lie between, since a machine is not as fast at the end as it was then. Between
// these the clock has no say: learning rate and curriculum depend on steps alone, and a run of `--steps` can be had
// again.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "services/core/config.h"
#include "services/core/result.h"

namespace etude::learn {

/// Steps are measured over this many at first, and over as many or more at each look: of few, a checkpoint or a
/// validation beside them is most of the time.
inline constexpr std::uint64_t kMeasuredSteps = 200;
/// Of the run's progress: where what minutes have become is measured again.
inline constexpr std::array kLooks{0.25, 0.5, 0.75, 0.9, 0.97};
/// A difference of at most this share of the steps that are left changes nothing.
inline constexpr double kSameSteps = 0.01;

/// Pure: time is told to it. Not thread-safe.
class RunLimit {
 public:
  /// @param steps    0: no limit by steps    @param minutes  of training; 0: no limit by time
  RunLimit(std::uint64_t steps, double minutes)
      : asked_steps_(steps), steps_(steps), asked_minutes_(minutes), minutes_(minutes) {}

  /// Of the run, 0..1; never falls over a conversion.
  double Progress(std::uint64_t step, double elapsed_s) const;

  /// Tells of a finished step. @param whole  every module is in training: only then does a step cost what the rest
  /// of the run's steps will. @returns true when minutes have just become steps, or other steps than before
  bool Observe(std::uint64_t step, double elapsed_s, bool whole);
  /// The run ended by time before it could be measured: it was as many steps as were done.
  void EndAt(std::uint64_t step);

  std::uint64_t steps() const { return steps_; }
  double minutes() const { return minutes_; }  ///< 0 once they are steps
  double asked_minutes() const { return asked_minutes_; }

  OrderedJson Save() const;
  /// Goes on with what an earlier run converted, unless another limit was asked for: the same minutes, or the steps
  /// that they became. @error kCorrupt: `saved` is not what Save gives; the limit is unchanged.
  Status Restore(const OrderedJson& saved);

 private:
  void Convert(std::uint64_t step, double progress, std::uint64_t steps);
  bool Measure(std::uint64_t step, double elapsed_s, bool whole);
  bool LookAgain(std::uint64_t step, double elapsed_s);
  /// Steps of the whole run, where those from `since` on took what the rest will.
  std::uint64_t StepsLike(std::uint64_t since, double since_s, std::uint64_t step, double elapsed_s) const;

  std::uint64_t asked_steps_, steps_;
  double asked_minutes_, minutes_;
  // progress is a line from here to (steps_, 1)
  std::uint64_t anchor_step_ = 0;
  double anchor_progress_ = 0;
  std::size_t looks_ = 0;          // at what the minutes are by now
  std::uint64_t looked_step_ = 0;  // the last of them, or the conversion
  double looked_s_ = 0;
  std::uint64_t steps_before_ = 0;  // the last look changed them: config.yaml may still say these
  // first of the steps that are measured
  bool measuring_ = false;
  std::uint64_t first_step_ = 0;
  double first_s_ = 0;
};

}  // namespace etude::learn
