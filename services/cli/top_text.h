// SPDX-License-Identifier: Apache-2.0
// What `etude top` shows, as text.
#pragma once

#include <string>

#include "services/cli/bus_watch.h"

namespace etude::cli {

/// What goes on, in one sentence: "quickstart: collecting 412 of 600, done in 3:05; training stage 5/5 CTRL, step
/// 6,589; step 6,500 serves 1 session".
std::string StateSentence(const BusView& view, MonotonicClock::time_point now);

/// One screen: the sentence, campaigns with their workers, runs with stage and losses, who serves them. What is silent
/// for more than 3 s says so.
/// @param rows, columns  of the screen; workers that do not fit are counted. 0: no bound
std::string TopText(const BusView& view, MonotonicClock::time_point now, std::size_t rows = 0, std::size_t columns = 0);

}  // namespace etude::cli
