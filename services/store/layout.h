// SPDX-License-Identifier: Apache-2.0
// Names in a dataset's folder, its lock and its dataset.json.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/file_lock.h"
#include "services/core/result.h"
#include "services/spec/campaign_spec.h"
#include "services/spec/content_version.h"
#include "services/store/dataset.h"

namespace etude::store::internal {

inline constexpr const char* kDatasetJson = "dataset.json";
inline constexpr const char* kMasterFile = "dataset.hdf5";
inline constexpr const char* kAttempts = "attempts.jsonl";
inline constexpr const char* kCommits = "commits.jsonl";
inline constexpr const char* kSampling = "sampling.jsonl";
inline constexpr const char* kFilters = "filters.json";
inline constexpr const char* kEpisodes = "episodes";
inline constexpr const char* kQuarantine = "quarantine";
inline constexpr const char* kLock = ".lock";

/// The episode whose file `path` is, by its name and folder; nothing for any other name.
std::optional<std::uint64_t> IndexOf(const Path& path);

/// Paths of all that lies two levels under episodes/, but in hidden folders, sorted: also of what is no file, so that
/// verify can tell of it. @error kUnavailable
Result<std::vector<Path>> ListEpisodeFolder(const Path& dataset);
/// Bytes of the episodes' files among these, by index; 0 where the file cannot be asked.
std::map<std::uint64_t, std::uint64_t> SizesOf(const std::vector<Path>& files);

/// Keeps other writers out as long as what it returns lives.
/// @error kUnavailable when another one holds it (names the process), or the folder is not writable.
Result<FileLock> LockDataset(const Path& dataset);

/// Content of dataset.json.
struct DatasetFile {
  CampaignSpec spec;
  OrderedJson statistics = OrderedJson::object();
  std::string spec_sha256 = {};  ///< as read; what is written is the spec's own
  int schema_version = kSchemaVersion;
  std::int64_t content = kContentVersion;  ///< as read, 0 when it does not say; what is written is our own
};

/// @error kNotFound, kCorrupt, kInvalidArgument (a schema version that is not known)
Result<DatasetFile> ReadDatasetFile(const Path& dataset);
Status WriteDatasetFile(const Path& dataset, const DatasetFile& content);
/// Why no episode can be added to it any more, as what follows "it"; "": one can.
std::string WhyClosed(const DatasetFile& found);

/// Keys of the spec that an episode's bytes depend on and that differ, as "seed (1, now 2)".
std::vector<std::string> SpecDifferences(const CampaignSpec& made_from, const CampaignSpec& now);
/// Of what is no part of the hash and decides all the same on what an episode is, and what it is for: name and split.
std::vector<std::string> DifferencesBesideHash(const CampaignSpec& first, const CampaignSpec& other);

}  // namespace etude::store::internal
