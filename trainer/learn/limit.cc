// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/limit.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace etude::learn {

double RunLimit::Progress(std::uint64_t step, double elapsed_s) const {
  double progress = 0;
  if (steps_ > 0) {
    const auto left = static_cast<double>(steps_ > anchor_step_ ? steps_ - anchor_step_ : 0);
    const auto done = static_cast<double>(step > anchor_step_ ? step - anchor_step_ : 0);
    progress = left > 0 ? anchor_progress_ + (1 - anchor_progress_) * done / left : 1;
  }
  if (minutes_ > 0) progress = std::max(progress, elapsed_s / (60 * minutes_));
  return std::min(1.0, progress);
}

void RunLimit::Convert(std::uint64_t step, double progress, std::uint64_t steps) {
  steps_ = asked_steps_ > 0 ? std::min(asked_steps_, steps) : steps;
  anchor_step_ = step;
  anchor_progress_ = progress;
  minutes_ = 0;
}

std::uint64_t RunLimit::StepsLike(std::uint64_t since, double since_s, std::uint64_t step, double elapsed_s) const {
  const double each_s = (elapsed_s - since_s) / static_cast<double>(step - since);
  const double left_s = std::max(0.0, 60 * asked_minutes_ - elapsed_s);
  return step + static_cast<std::uint64_t>(each_s > 0 ? std::llround(left_s / each_s) : 0);
}

bool RunLimit::Observe(std::uint64_t step, double elapsed_s, bool whole) {
  return minutes_ > 0 ? Measure(step, elapsed_s, whole) : LookAgain(step, elapsed_s);
}

bool RunLimit::Measure(std::uint64_t step, double elapsed_s, bool whole) {
  if (!whole) {
    measuring_ = false;
    return false;
  }
  if (!measuring_) {
    measuring_ = true;
    first_step_ = step;
    first_s_ = elapsed_s;
    return false;
  }
  if (step - first_step_ < kMeasuredSteps) return false;
  const std::uint64_t steps = StepsLike(first_step_, first_s_, step, elapsed_s);
  Convert(step, Progress(step, elapsed_s), steps);
  looked_step_ = step;
  looked_s_ = elapsed_s;
  return true;
}

// By the steps since the last time. What was done before it is past a change of speed, too.
bool RunLimit::LookAgain(std::uint64_t step, double elapsed_s) {
  if (asked_minutes_ <= 0 || looks_ >= kLooks.size() || step >= steps_) return false;
  if (Progress(step, elapsed_s) < kLooks[looks_]) return false;
  if (step < looked_step_ + kMeasuredSteps) return false;  // it is due, and waits
  while (looks_ < kLooks.size() && Progress(step, elapsed_s) >= kLooks[looks_]) ++looks_;
  const std::uint64_t steps = StepsLike(looked_step_, looked_s_, step, elapsed_s);
  looked_step_ = step;
  looked_s_ = elapsed_s;
  const double left = static_cast<double>(steps_) - static_cast<double>(step);
  const double more = static_cast<double>(steps) - static_cast<double>(steps_);
  if (std::abs(more) <= kSameSteps * left) return false;
  const std::uint64_t before = steps_;
  Convert(step, Progress(step, elapsed_s), steps);
  steps_before_ = before;
  return steps_ != before;
}

void RunLimit::EndAt(std::uint64_t step) {
  if (minutes_ > 0) Convert(step, 1, step);
}

OrderedJson RunLimit::Save() const {
  return {{"asked_minutes", asked_minutes_},
          {"asked_steps", asked_steps_},
          {"minutes", minutes_},
          {"steps", steps_},
          {"anchor_step", anchor_step_},
          {"anchor_progress", anchor_progress_},
          {"looks", looks_},
          {"looked_step", looked_step_},
          {"looked_s", looked_s_},
          {"steps_before", steps_before_}};
}

Status RunLimit::Restore(const OrderedJson& saved) {
  RunLimit other(0, 0);
  try {
    other.asked_minutes_ = saved.at("asked_minutes");
    other.minutes_ = saved.at("minutes");
    other.steps_ = saved.at("steps");
    other.anchor_step_ = saved.at("anchor_step");
    other.anchor_progress_ = saved.at("anchor_progress");
    // states of before have converted once and for all
    other.asked_steps_ = saved.value("asked_steps", std::uint64_t{0});
    other.looks_ = saved.value("looks", kLooks.size());
    // those of a while ago looked three times, and measured from where they had been converted
    if (!saved.contains("looked_step") && other.looks_ >= 3) other.looks_ = kLooks.size();
    other.looked_step_ = saved.value("looked_step", other.anchor_step_);
    other.looked_s_ = saved.value("looked_s", saved.value("anchor_s", 0.0));
    other.steps_before_ = saved.value("steps_before", std::uint64_t{0});
  } catch (const nlohmann::json::exception& error) {
    return Fail(Code::kCorrupt, fmt::format("limit of the run: {}", error.what()));
  }
  const bool same_bound = !saved.contains("asked_steps") || asked_steps_ == other.asked_steps_;
  const bool same_minutes = minutes_ > 0 && minutes_ == other.asked_minutes_ && same_bound;
  const bool same_steps = minutes_ == 0 && steps_ > 0 && (steps_ == other.steps_ || steps_ == other.steps_before_);
  if (other.minutes_ == 0 && (same_minutes || same_steps)) *this = other;
  return {};
}

}  // namespace etude::learn
