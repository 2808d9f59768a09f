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
  steps_ = steps_ > 0 ? std::min(steps_, steps) : steps;
  anchor_step_ = step;
  anchor_progress_ = progress;
  minutes_ = 0;
}

bool RunLimit::Observe(std::uint64_t step, double elapsed_s, bool whole) {
  if (minutes_ <= 0) return false;
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
  const double each_s = (elapsed_s - first_s_) / static_cast<double>(step - first_step_);
  const double left_s = std::max(0.0, 60 * minutes_ - elapsed_s);
  const double progress = Progress(step, elapsed_s);
  Convert(step, progress, step + static_cast<std::uint64_t>(each_s > 0 ? std::llround(left_s / each_s) : 0));
  return true;
}

void RunLimit::EndAt(std::uint64_t step) {
  if (minutes_ > 0) Convert(step, 1, step);
}

OrderedJson RunLimit::Save() const {
  return {{"asked_minutes", asked_minutes_},
          {"minutes", minutes_},
          {"steps", steps_},
          {"anchor_step", anchor_step_},
          {"anchor_progress", anchor_progress_}};
}

Status RunLimit::Restore(const OrderedJson& saved) {
  RunLimit other(0, 0);
  try {
    other.asked_minutes_ = saved.at("asked_minutes");
    other.minutes_ = saved.at("minutes");
    other.steps_ = saved.at("steps");
    other.anchor_step_ = saved.at("anchor_step");
    other.anchor_progress_ = saved.at("anchor_progress");
  } catch (const nlohmann::json::exception& error) {
    return Fail(Code::kCorrupt, fmt::format("limit of the run: {}", error.what()));
  }
  const bool same_minutes = minutes_ > 0 && minutes_ == other.asked_minutes_;
  const bool same_steps = minutes_ == 0 && steps_ == other.steps_;
  if (other.minutes_ == 0 && (same_minutes || same_steps)) *this = other;
  return {};
}

}  // namespace etude::learn
