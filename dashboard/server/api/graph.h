// SPDX-License-Identifier: Apache-2.0
// A policy's modules and what flows between them, from a run's config.yaml and its newest checkpoint's header.
#pragma once

#include "dashboard/server/sources/run_source.h"

namespace etude::api {

/// Graph of openapi.json. @error kNotFound: the run has no config yet
Result<OrderedJson> GraphJson(const sources::RunView& view);

}  // namespace etude::api
