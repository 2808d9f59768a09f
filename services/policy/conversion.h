// SPDX-License-Identifier: Apache-2.0
// Between the structs of this folder and the bus's messages. Internal to services/policy.
#pragma once

#include <span>
#include <vector>

#include "services/bus/messages.h"
#include "services/policy/policy_types.h"

namespace etude::policy {

/// Everything but run, session and request, which are the conversation's.
bus::Observation ObservationOf(const Question& question);

/// Whether these are kWaypoints * kWaypointSize finite numbers.
bool AreWaypoints(std::span<const float> numbers);
/// @pre AreWaypoints
std::vector<Waypoint> WaypointsOf(std::span<const float> numbers);

}  // namespace etude::policy
