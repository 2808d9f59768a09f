// SPDX-License-Identifier: Apache-2.0
// Writing that waits for room.
#pragma once

#include <chrono>
#include <functional>
#include <string>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude {

/// Does `write`; where the disk cannot take it now (kUnavailable: full, read-only, a file system that is away), again
/// every `pause` until it can, or a stop is requested. Each new reason is logged once, and that it went on.
/// `write` must be one that may be repeated.
/// @param what  "the checkpoint of step 300"
/// @param before_pause  called before each pause: what a wait that is right has to tell (WatchedLoop::Moved)
/// @error of `write`: another one than kUnavailable at once, that one only after a stop request
Status WriteWhenThereIsRoom(const std::string& what, const std::function<Status()>& write,
                            std::chrono::milliseconds pause = std::chrono::milliseconds(1000),
                            const std::function<void()>& before_pause = {});

/// Asked before such a wait: a folder that must not be written has no less room tomorrow.
/// @error kUnavailable: it is not allowed
Status CheckMayWrite(const Path& folder);

}  // namespace etude
