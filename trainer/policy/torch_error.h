// SPDX-License-Identifier: Apache-2.0
// What torch throws, as an error value. Any thread.
#pragma once

#include <exception>
#include <string_view>

#include "services/core/result.h"

namespace etude::policy {

/// "`what`: its words", without torch's backtrace: kUnavailable where memory ran out, a GPU's that others fill or this
/// machine's; else `otherwise`.
Error TorchError(std::string_view what, const std::exception& thrown, Code otherwise = Code::kInternal);

}  // namespace etude::policy
