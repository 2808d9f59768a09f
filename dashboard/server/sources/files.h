// SPDX-License-Identifier: Apache-2.0
// Reading files that other processes write: below a folder and nowhere else, and only what is new.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "services/core/config.h"
#include "services/core/descriptor.h"
#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::sources {

/// Tells whether a file is the one that was read before.
struct FileStamp {
  std::uint64_t device = 0, inode = 0, size = 0;
  std::int64_t modified_ns = 0;  ///< since 1970

  bool operator==(const FileStamp&) const = default;
  bool exists() const { return inode != 0; }
  double modified_s() const { return static_cast<double>(modified_ns) * 1e-9; }
  /// A strong validator: "device-inode-size-time" in hexadecimal.
  std::string tag() const;
};
/// Nothing there, or no regular file: a stamp that does not exist.
FileStamp StampOf(const Path& path);

struct ConfinedFile {
  Descriptor file;
  FileStamp stamp;
};
/// Opens FOLDER/relative for reading; no step of `relative` may be a link, "..", or absolute.
/// @error kNotFound: it is not there, or not a regular file; kInvalidArgument: it would leave the folder
Result<ConfinedFile> OpenBelow(const Path& folder, const Path& relative);

/// A file of one JSON object a line, read while it grows. Not thread-safe.
class JsonLines {
 public:
  explicit JsonLines(Path path) : path_(std::move(path)) {}

  /// Calls `line` for each whole line that came since the last call. When the file was replaced or cut, calls `reset`
  /// first and reads it from its begin. A last line without its end waits for the next call.
  void Refresh(const std::function<void()>& reset, const std::function<void(const OrderedJson&)>& line);

  const FileStamp& stamp() const { return stamp_; }
  /// What stood behind the last line's end at the last call: a line under way, or torn.
  bool torn() const { return torn_; }

 private:
  Path path_;
  FileStamp stamp_;
  std::uint64_t offset_ = 0;
  std::string before_;  // what stands before it
  bool torn_ = false;
};

/// "2026-01-31T12:00:00.123Z"
std::string Rfc3339(double seconds_since_1970);
/// Its inverse, or plain seconds. nullopt: neither.
std::optional<double> ParseTime(const std::string& text);
OrderedJson TimeJson(std::optional<double> seconds_since_1970);

// Fields of JSON that is not ours to trust: what is missing or of another kind is the fallback.
std::string TextOf(const OrderedJson& json, const char* key, const std::string& fallback = "");
std::optional<double> NumberOf(const OrderedJson& json, const char* key);
std::optional<std::uint64_t> UnsignedOf(const OrderedJson& json, const char* key);
bool FlagOf(const OrderedJson& json, const char* key);
const OrderedJson& PartOf(const OrderedJson& json, const char* key);  ///< null when missing
/// null when there is none.
template <class T>
OrderedJson Maybe(const std::optional<T>& value) {
  return value ? OrderedJson(*value) : OrderedJson();
}
inline OrderedJson TextOrNull(const std::string& text) { return text.empty() ? OrderedJson() : OrderedJson(text); }

}  // namespace etude::sources
