// SPDX-License-Identifier: Apache-2.0
// Making files appear whole, durable, or not at all.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::store::internal {

/// What a temporary file's name ends with; a crash may leave some behind.
inline constexpr std::string_view kTemporarySuffix = ".tmp";

/// A file whose bytes lie in several places.
struct FileToCommit {
  Path path;
  std::vector<std::span<const std::uint8_t>> pieces;
};
/// Each is written under a temporary name and fsynced, then all are renamed, then each folder (and parents that it
/// makes) is fsynced once. Thread-safe for different paths. @returns for each file: on error neither it nor the
/// temporary one is there, kUnavailable when the disk refuses; one that fails takes none but those of its folder along,
/// and those only where that folder's fsync failed.
std::vector<Status> CommitFiles(std::span<const FileToCommit> files);

/// Where a crash may strike between two system calls of CommitFiles.
enum class CommitPoint { kCreated, kWritten, kSynced, kRenamed, kDone };

/// For crash tests: called at each point, when set. Not thread-safe.
void SetCommitProbe(std::function<void(CommitPoint)> probe);

}  // namespace etude::store::internal
