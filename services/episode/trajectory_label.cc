// SPDX-License-Identifier: Apache-2.0
#include "services/episode/trajectory_label.h"

#include <algorithm>
#include <cmath>

#include "services/core/check.h"
#include "services/episode/pose.h"

namespace etude {
namespace {

// commanded pose and gripper of row t, the last row when t lies behind the end
Waypoint CommandAt(const Episode& episode, int t) {
  return FromVector(episode.actions_abs.row(std::min(t, episode.actions_abs.rows() - 1)).data());
}

}  // namespace

bool Supervised(const Episode& episode, int step) {
  const auto t = static_cast<std::size_t>(step);
  return t >= episode.supervise.size() || episode.supervise[t] != 0;
}

TrajectoryLabel LabelTrajectory(const Episode& episode, int step) {
  ETUDE_CHECK(step >= 0 && step < episode.steps(), "step={} of {}", step, episode.steps());
  TrajectoryLabel label;
  int checked = step;  // every step before this one is supervised
  bool valid = true;
  for (int k = 0; k < kWaypoints; ++k) {
    const double at = step + WaypointStep(k);
    const int below = static_cast<int>(std::floor(at));
    const int above = static_cast<int>(std::ceil(at));
    for (; valid && checked <= above && checked < episode.steps(); ++checked) valid = Supervised(episode, checked);
    label.valid[k] = valid;

    // between two commands: straight in position, slerp in orientation, the past gripper
    Waypoint waypoint = CommandAt(episode, below);
    const Waypoint next = CommandAt(episode, above);
    const double t = at - below;
    waypoint.X_WE.p = (1 - t) * waypoint.X_WE.p + t * next.X_WE.p;
    waypoint.X_WE.q = waypoint.X_WE.q.slerp(t, next.X_WE.q);
    const auto values = ToVector(waypoint);
    std::copy(values.begin(), values.end(), label.values.begin() + k * kWaypointSize);
  }
  return label;
}

}  // namespace etude
