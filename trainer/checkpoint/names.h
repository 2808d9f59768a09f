// SPDX-License-Identifier: Apache-2.0
// Names that a run and its checkpoints have, in folders and on the bus.
#pragma once

#include <cstdint>
#include <string>

#include "services/core/file.h"

namespace etude::checkpoint {

inline constexpr char kLatest[] = "latest";
inline constexpr char kBest[] = "best";

/// "Out/My Run" -> "my-run": a plain name for a folder.
std::string RunNameOf(const Path& folder);

/// "00001500.safetensors".
Path FileNameOf(std::uint64_t step);

/// FOLDER/latest.safetensors.
Path LinkOf(const Path& folder, const std::string& channel);

}  // namespace etude::checkpoint
