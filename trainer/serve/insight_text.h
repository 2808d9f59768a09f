// SPDX-License-Identifier: Apache-2.0
// An insight (insight.h) in words. What it says comes from the bus: what is no insight's becomes no text.
#pragma once

#include <string>

#include "services/bus/messages.h"

namespace etude::serve {

/// Lines for people: what every module says, beside it what it would, and where it looks as the mean over its heads;
/// the plan's first and last waypoint and how far it would move; what words and joints are worth.
std::string InsightText(const bus::Insight& insight);
/// All of it as a line of JSON; attention and picture as their bytes, see insight.h.
std::string InsightLine(const bus::Insight& insight);

}  // namespace etude::serve
