// SPDX-License-Identifier: Apache-2.0
// The figures of runs: in buckets for charts, and as one table.
#pragma once

#include "dashboard/server/api/context.h"

namespace etude::api {

/// /runs/{id}/series: of each of `keys` the arrays x, min, max, last and step of its buckets over the abscissa `x`,
/// `points` of them at most; keys that the run does not have are left out. @error kNotFound: no such run;
/// kInvalidArgument: a bound that is no number, another abscissa, too many keys
Result<http::Answer> SeriesAnswer(Context& context, const http::Request& request);

/// /runs/{id}/series.csv: a row for each line of metrics.jsonl, of this run and of those in `run`; its run and its kind
/// stand in columns, so that who loads it tells them apart. @error kNotFound: no such run; kInvalidArgument: too many
Result<http::Answer> SeriesCsv(Context& context, const http::Request& request);

}  // namespace etude::api
