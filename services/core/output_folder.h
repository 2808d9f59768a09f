// SPDX-License-Identifier: Apache-2.0
// A folder or file that appears whole or not at all: it is made beside its place, as OUT.partial, and renamed at the
// end.
#pragma once

#include <cstdint>
#include <utility>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude {

enum class Leftover : std::uint8_t {
  kRefuse,  ///< what an interrupted command left is an error that says so
  kRemove,  ///< it is removed, and all begins anew
};

enum class Made : std::uint8_t { kFile, kFolder };

/// Where to make `out` until it is whole: OUT.partial beside it, or beside what OUT is a link to. Its parent folders
/// are made.
/// @error kInvalidArgument: OUT is there and not an empty folder, which only a folder may take the place of, it is a
/// link that leads nowhere, a disk is mounted there, it names a folder where a file is made, or OUT.partial is there
/// and `leftover` refuses; kUnavailable of the disk
Result<Path> ClaimOutput(const Path& out, Made made, Leftover leftover);
/// Gives what was made its own name; durable when it returns, if its content is. @error kUnavailable of the disk
Status CommitOutput(const Path& partial, const Path& out);

/// Not thread-safe. Without Commit the unfinished folder stays, under its own name.
class OutputFolder {
 public:
  /// @error as ClaimOutput
  static Result<OutputFolder> Create(const Path& out, Leftover leftover);

  /// Where to write until Commit.
  const Path& path() const { return partial_; }
  /// Durable under its own name when it returns.
  Status Commit();

 private:
  OutputFolder(Path out, Path partial) : out_(std::move(out)), partial_(std::move(partial)) {}
  Path out_, partial_;
};

}  // namespace etude
