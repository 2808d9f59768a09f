// SPDX-License-Identifier: Apache-2.0
// What `etude top` and `etude campaign` show, for programs.
#pragma once

#include "services/cli/bus_watch.h"
#include "services/core/config.h"

namespace etude::cli {

/// A campaign as its collector says it is; without a state while nothing was heard.
OrderedJson StatusJson(const CampaignView& campaign);

/// {domain, sentence, campaigns, runs}: campaigns as StatusJson with `worker_list`, runs with the servers of their
/// policy. `heard_s` is how long ago each spoke; null: not yet.
OrderedJson TopJson(const BusView& view, MonotonicClock::time_point now);

}  // namespace etude::cli
