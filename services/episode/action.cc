// SPDX-License-Identifier: Apache-2.0
#include "services/episode/action.h"

#include <algorithm>

#include "services/core/check.h"

namespace etude {

std::array<float, kWaypointSize> ToVector(const Waypoint& waypoint) {
  const Rotation6D rotation = ToRotation6D(waypoint.X_WE.q);
  std::array<float, kWaypointSize> values{};
  for (int i = 0; i < 3; ++i) values[i] = static_cast<float>(waypoint.X_WE.p[i]);
  for (int i = 0; i < 6; ++i) values[3 + i] = static_cast<float>(rotation[i]);
  values[9] = static_cast<float>(waypoint.gripper);
  return values;
}

Waypoint FromVector(const float* values) {
  Rotation6D rotation;
  std::copy_n(values + 3, rotation.size(), rotation.begin());
  return {{{values[0], values[1], values[2]}, FromRotation6D(rotation)}, values[9]};
}

double WaypointStep(int k) { return k * (kHorizonSteps - 1.0) / (kWaypoints - 1.0); }

Waypoint Interpolate(const std::vector<Waypoint>& waypoints, double step) {
  ETUDE_CHECK(static_cast<int>(waypoints.size()) == kWaypoints, "{}", waypoints.size());
  const double s = std::clamp(step / WaypointStep(1), 0.0, kWaypoints - 1.0);
  const int below = std::min(static_cast<int>(s), kWaypoints - 2);
  const double t = s - below;
  const Waypoint& a = waypoints[below];
  const Waypoint& b = waypoints[below + 1];
  Waypoint result;
  result.X_WE.p = (1 - t) * a.X_WE.p + t * b.X_WE.p;
  result.X_WE.q = a.X_WE.q.slerp(t, b.X_WE.q);
  result.gripper = t < 1 ? a.gripper : b.gripper;
  return result;
}

}  // namespace etude
