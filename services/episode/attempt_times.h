// SPDX-License-Identifier: Apache-2.0
// Where the time of an attempt went. It varies from host to host and from run to run, so that it is never part of an
// episode: it travels and is kept beside it.
#pragma once

#include <algorithm>
#include <cmath>

#include "services/core/config.h"

namespace etude {

/// Seconds; 0 where nothing was measured.
struct AttemptTimes {
  double plan_s = 0, step_s = 0, render_s = 0, deflate_s = 0;
  double wall_s = 0;  ///< the whole attempt, by the clock

  /// fn(name, value) for each of them, in a fixed order.
  template <class Times, class Function>
  static void Each(Times& times, Function&& fn) {
    fn("plan_s", times.plan_s);
    fn("step_s", times.step_s);
    fn("render_s", times.render_s);
    fn("deflate_s", times.deflate_s);
    fn("wall_s", times.wall_s);
  }
  bool operator==(const AttemptTimes&) const = default;
};

/// {"plan_s", "step_s", "render_s", "deflate_s", "wall_s"}; what was not measured is left out.
inline OrderedJson TimesJson(const AttemptTimes& times) {
  OrderedJson json = OrderedJson::object();
  AttemptTimes::Each(times, [&](const char* name, double value) {
    if (value > 0) json[name] = value;
  });
  return json;
}

/// What a process or a file says; what is missing, no number, or no time that an attempt can take is 0.
inline AttemptTimes TimesOf(const OrderedJson& json) {
  constexpr double kLongest = 1e6;
  AttemptTimes times;
  if (!json.is_object()) return times;
  AttemptTimes::Each(times, [&](const char* name, double& value) {
    const auto found = json.find(name);
    if (found == json.end() || !found->is_number()) return;
    const double seconds = found->get<double>();
    if (std::isfinite(seconds)) value = std::clamp(seconds, 0.0, kLongest);
  });
  return times;
}

}  // namespace etude
