// SPDX-License-Identifier: Apache-2.0
// All of what is appended to a file, or nothing: what reads records one after the other finds nothing behind a part of
// one.
#pragma once

#include <cstdint>
#include <span>

#include "services/core/file.h"

namespace etude {

/// Writes `bytes` to the end of a file that was opened with O_APPEND; where that fails (a full disk), the file is cut
/// back to where it was, and if not even that works, a warning says so. `path` is for the error's words.
/// @error kUnavailable
Status AppendWhole(int fd, const Path& path, std::span<const std::uint8_t> bytes);

}  // namespace etude
