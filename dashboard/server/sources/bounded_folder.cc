// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/sources/bounded_folder.h"

#include <algorithm>
#include <vector>

namespace etude::sources {
namespace {

// Of a file, or of all files below a folder.
std::uint64_t BytesOf(const std::filesystem::directory_entry& entry) {
  std::error_code error;
  if (entry.is_regular_file(error)) return entry.file_size(error);
  std::uint64_t bytes = 0;
  for (std::filesystem::recursive_directory_iterator it(entry.path(), error), end; !error && it != end;
       it.increment(error)) {
    std::error_code ignored;
    if (it->is_regular_file(ignored) && !it->is_symlink(ignored)) bytes += it->file_size(ignored);
  }
  return bytes;
}

}  // namespace

void MarkUsed(const Path& entry) {
  std::error_code ignored;
  std::filesystem::last_write_time(entry, std::filesystem::file_time_type::clock::now(), ignored);
}

void TrimFolder(const Path& folder, std::uint64_t most_bytes, const Path& keep,
                const std::function<bool(const Path& entry)>& counts) {
  struct Entry {
    Path path;
    std::uint64_t size;
    std::filesystem::file_time_type used;
  };
  std::vector<Entry> entries;
  std::uint64_t total = 0;
  std::error_code error;
  for (std::filesystem::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    std::error_code ignored;
    if (it->is_symlink(ignored) || !counts(it->path())) continue;
    entries.push_back({it->path(), BytesOf(*it), it->last_write_time(ignored)});
    total += entries.back().size;
  }
  std::ranges::sort(entries, {}, &Entry::used);
  for (const auto& entry : entries) {
    if (total <= most_bytes) return;
    if (entry.path == keep) continue;
    std::error_code ignored;
    std::filesystem::remove_all(entry.path, ignored);
    total -= entry.size;
  }
}

}  // namespace etude::sources
