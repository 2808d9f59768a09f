// SPDX-License-Identifier: Apache-2.0
// Checkpoints of a run: what each is, who serves it, its file.
#pragma once

#include "dashboard/server/api/context.h"

namespace etude::api {

/// /runs/{id}/checkpoints: newest first, when the next is due, and who reads what the run publishes. Their hashes are
/// worked out in the background. @error kNotFound: no such run
Result<http::Answer> Checkpoints(Context& context, const http::Request& request);
/// /runs/{id}/checkpoints/{file}, to be saved. @error kNotFound: no such run, or no such checkpoint of it
Result<http::Answer> CheckpointFile(Context& context, const http::Request& request);

}  // namespace etude::api
