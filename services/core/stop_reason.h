// SPDX-License-Identifier: Apache-2.0
// A stop that is a failure: work drains as after a signal, and then the process ends with an error, so that whoever
// supervises it starts it again.
#pragma once

#include <optional>

#include "services/core/result.h"

namespace etude {

/// Requests a stop for a reason; the first one counts. Thread-safe.
void StopBecause(Error error);
/// What RunMain ends the process with when its body had no error of its own.
std::optional<Error> ReasonOfStop();

}  // namespace etude
