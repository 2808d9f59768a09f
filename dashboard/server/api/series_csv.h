// SPDX-License-Identifier: Apache-2.0
// The figures of runs as one table, for those who draw it themselves.
#pragma once

#include "dashboard/server/api/context.h"

namespace etude::api {

/// /runs/{id}/series.csv: a row for each line of metrics.jsonl, of this run and of those in `run`; its run and its kind
/// stand in columns, so that who loads it tells them apart. @error kNotFound: no such run; kInvalidArgument: too many
Result<http::Answer> SeriesCsv(Context& context, const http::Request& request);

}  // namespace etude::api
