// SPDX-License-Identifier: Apache-2.0
// What /metrics has, for Prometheus (metrics.cc).
#pragma once

#include <string>

namespace etude::api {

/// The "# HELP" and "# TYPE" lines of /metrics: what there is to scrape, without a campaign or a run.
std::string MetricFamilies();

}  // namespace etude::api
