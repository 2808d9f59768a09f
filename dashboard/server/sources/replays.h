// SPDX-License-Identifier: Apache-2.0
// Attempts that were made again (`etude attempt replay`), kept in a folder of bounded size: FOLDER/<key>, which is
// there when it is whole. Each with pictures is a dataset of one episode, which the catalog never lists.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "dashboard/server/sources/catalog.h"
#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::sources {

/// Thread-safe; several gateways may share the folder.
class Replays {
 public:
  explicit Replays(Path folder, std::uint64_t most_bytes = 1ull << 30)
      : folder_(std::move(folder)), most_bytes_(most_bytes) {}

  const Path& folder() const { return folder_; }
  /// Of all that the attempt's bytes depend on: 32 hexadecimal digits.
  static std::string KeyOf(const std::vector<std::string>& what);
  /// As a dataset it is called "replay.<key>".
  static std::string IdOf(const std::string& key) { return "replay." + key; }
  static std::optional<std::string> KeyIn(const std::string& id);

  /// Its folder; this is its last use. @error kNotFound
  Result<Path> Find(const std::string& key) const;
  /// Its dataset. @error kNotFound: also of an attempt that ended before anything moved
  Result<Found> FindDataset(const std::string& key) const;
  /// Whether FindDataset would find it; for lists, which are no use of it.
  bool HasEpisode(const std::string& key) const;

  /// A folder that is not there yet, for it while it is made.
  Path NewPlace(const std::string& key) const;
  /// What was made there is whole. Another one of this key that is there stays in its place.
  Status Keep(const Path& place, const std::string& key) const;
  static void Discard(const Path& place);
  /// Those that were looked at the longest time ago go, and what an interrupted gateway left.
  void Trim(const std::string& keep = "") const;

 private:
  bool Has(const std::string& key, const char* file) const;
  Path folder_;
  std::uint64_t most_bytes_;
};

}  // namespace etude::sources
