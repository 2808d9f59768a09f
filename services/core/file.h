// SPDX-License-Identifier: Apache-2.0
// Durable files: what these functions report as written is on the disk.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "services/core/descriptor.h"
#include "services/core/result.h"

namespace etude {

using Path = std::filesystem::path;

/// `errno`'s text with what was attempted: "write '/d/x': No space left on device". Disk full and
/// permission become kUnavailable, a missing file kNotFound.
Error ErrnoError(std::string_view attempted, const Path& path, int error_number);

/// @error kNotFound, kUnavailable; kExhausted when larger than `max_bytes`.
Result<std::string> ReadTextFile(const Path& path, std::uint64_t max_bytes = 1ull << 30);
Result<std::vector<std::uint8_t>> ReadBinaryFile(const Path& path, std::uint64_t max_bytes = 1ull << 34);
/// As ReadTextFile; nothing where there is no such file.
Result<std::optional<std::string>> ReadTextFileIfThere(const Path& path, std::uint64_t max_bytes = 1ull << 30);

/// Reads from `offset` on until `bytes` is full or the file ends. @return how many bytes were read
Result<std::size_t> ReadAt(int fd, const Path& path, std::uint64_t offset, std::span<std::uint8_t> bytes);
/// Writes all of `bytes` where the file stands; `path` is for the error's words. After an error a part may stand there.
Status WriteAll(int fd, const Path& path, std::span<const std::uint8_t> bytes);
Status WriteAll(int fd, const Path& path, std::string_view text);

/// Writes what nobody else may read: mode 0600 from the first byte on. @error kUnavailable when the file is there
Status WriteSecret(const Path& path, std::string_view text);

/// Writes a whole file so that a reader sees the old one or the new one, never a part: temporary name beside it, fsync,
/// rename, fsync of the folder. Makes missing parent folders; a device or a pipe is written to as it is.
/// On error no temporary file is left, and the old file is unchanged unless only the fsync of the folder failed.
Status WriteFileAtomically(const Path& path, std::span<const std::uint8_t> bytes);
Status WriteFileAtomically(const Path& path, std::string_view text);
/// The same of what is too large to be in memory at once: `write` gets the open file.
Status WriteFileAtomically(const Path& path, const std::function<Status(int fd)>& write);

/// Makes a rename or a new file in `folder` durable.
Status SyncFolder(const Path& folder);
/// fsyncs an existing file.
Status SyncFile(const Path& path);
Status MakeFolders(const Path& folder);  ///< with parents; their entries are durable, too

/// Appends whole lines to a text file, e.g. JSONL; opened once, each Append is one write(2).
/// Not thread-safe.
class LineAppender {
 public:
  static Result<LineAppender> Open(const Path& path);

  /// Writes `line` and a newline, or nothing. A torn last line (a crash, a full disk) is ended first.
  Status Append(std::string_view line);
  Status Sync() const;
  /// The same file once more: a slow disk then keeps nobody from appending while it is synced.
  /// @error kUnavailable: no descriptor is left
  Result<LineAppender> Duplicate() const;

 private:
  LineAppender(Path path, int fd) : path_(std::move(path)), file_(fd) {}
  Path path_;
  Descriptor file_;
};

/// When each file was written and how long it is, as one text: what was read from them holds while it is the same.
std::string StampOf(std::span<const Path> files);

/// True when `name` is fit to be a campaign, run or object name: [a-z0-9_-]{1,64}. Keeps names from
/// being paths.
bool IsPlainName(std::string_view name);

}  // namespace etude
