// SPDX-License-Identifier: Apache-2.0
// The stages of a run, as the Overview's ladder and the Training page show them.
#pragma once

#include "dashboard/server/api/context.h"

namespace etude::api {

/// [{stage, name, from_step, to_step, state, cause, reason}], from curriculum.jsonl; stages ahead have no steps.
OrderedJson StagesJson(const sources::RunView& view, const RunState& state);

}  // namespace etude::api
