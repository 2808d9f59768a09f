// SPDX-License-Identifier: Apache-2.0
// Caches on disk: folders of files, or of folders, that may be made again.
#pragma once

#include <cstdint>
#include <functional>

#include "services/core/file.h"

namespace etude::sources {

/// Makes this moment the time of its last use. What cannot be touched is only removed the sooner.
void MarkUsed(const Path& entry);

/// Removes the entries that were used the longest time ago until those of `folder` that `counts` take at most
/// `most_bytes`. Links are none. `keep` stays, however little may.
void TrimFolder(const Path& folder, std::uint64_t most_bytes, const Path& keep,
                const std::function<bool(const Path& entry)>& counts);

}  // namespace etude::sources
