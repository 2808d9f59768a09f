// SPDX-License-Identifier: Apache-2.0
// File names made of what came over the bus or out of a file: never a path.
#pragma once

#include <cstdint>
#include <string>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::cli {

/// "latest-00000012.safetensors". @error kInvalidArgument: the channel is no plain name (IsPlainName), so the
/// publisher is not one of Etude's
Result<std::string> CheckpointFileName(const std::string& channel, std::uint64_t version);

/// "000012-pick-timeout.mp4"; whatever is not a letter, a digit or one of "_+-" becomes "_", and words are cut.
std::string VideoFileName(std::uint64_t index, const std::string& task, const std::string& outcome);

/// Whether `derived` is there and not older than `source`, which may have been made anew since.
bool IsMadeOf(const Path& derived, const Path& source);

}  // namespace etude::cli
