// SPDX-License-Identifier: Apache-2.0
// Names that a run's checkpoints have in its folder.
#pragma once

#include <cstdint>
#include <string>

#include "services/core/file.h"

namespace etude::checkpoint {

inline constexpr char kLatest[] = "latest";
inline constexpr char kBest[] = "best";

/// "00001500.safetensors".
Path FileNameOf(std::uint64_t step);
/// Whether FileNameOf makes such names: others in the folder are links, or the user's.
bool IsFileName(const Path& name);

/// FOLDER/latest.safetensors.
Path LinkOf(const Path& folder, const std::string& channel);

}  // namespace etude::checkpoint
