// SPDX-License-Identifier: Apache-2.0
// What the judge of a rollout had seen by a moment of it.
#pragma once

#include <string>

#include "services/core/config.h"

namespace etude::cli {

/// "judge: target touched, latched at 3.20 s, done at 3.60 s, contact forearm-coke at 2.10 s"; "judge: nothing yet".
/// Latched: the authors' criterion, true once. Done: the strict one was held for its dwell, which is a success when
/// nothing was violated.
/// @param details  Episode::details as worker/task writes them; what is missing or of another kind is left out
/// @param step  control step up to which is told
std::string JudgeState(const OrderedJson& details, int step);

}  // namespace etude::cli
