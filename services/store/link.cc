// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <iterator>
#include <optional>
#include <unordered_map>

#include "services/store/attempts.h"
#include "services/store/edit.h"
#include "services/store/layout.h"

namespace etude::store {
namespace {

/// One of the datasets that are linked.
struct LinkedShard {
  Path path;
  CampaignSpec spec;
  std::string spec_sha256;
  std::vector<std::uint64_t> indices;
};

Result<LinkedShard> OpenShard(const Path& path) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, DatasetReader::Open(path));
  ETUDE_ASSIGN_OR_RETURN(const auto description, internal::ReadDatasetFile(path));
  if (const std::string why = internal::WhyClosed(description); !why.empty())
    return Fail(Code::kInvalidArgument,
                fmt::format("link '{}': it {}; `etude dataset merge` makes one of several", path.string(), why));
  ETUDE_ASSIGN_OR_RETURN(auto indices, reader.List());
  return LinkedShard{path, reader.spec(), reader.spec_sha256(), std::move(indices)};
}

// What shards of one campaign have alike: all that an episode's bytes depend on, its name, and which of them are for
// training.
Status CheckOneCampaign(const LinkedShard& first, const LinkedShard& other) {
  auto differences = internal::SpecDifferences(first.spec, other.spec);
  if (differences.empty() && first.spec_sha256 != other.spec_sha256)
    differences.emplace_back("what the files of its tasks say");
  std::ranges::copy(internal::DifferencesBesideHash(first.spec, other.spec), std::back_inserter(differences));
  if (differences.empty()) return {};
  return Fail(
      Code::kInvalidArgument,
      fmt::format("link: '{}' and '{}' are no shards of one campaign; different: {}. `etude dataset merge` makes "
                  "one dataset of several specs, and `etude train --data A B` reads several",
                  first.path.string(), other.path.string(), fmt::join(differences, ", ")));
}

/// Which shard each episode lies in.
using ShardOf = std::unordered_map<std::uint64_t, const LinkedShard*>;

Result<ShardOf> AssignEpisodes(const std::vector<LinkedShard>& shards) {
  ShardOf shard_of;
  for (const LinkedShard& shard : shards)
    for (const std::uint64_t index : shard.indices) {
      const auto [found, added] = shard_of.emplace(index, &shard);
      if (!added)
        return Fail(Code::kInvalidArgument,
                    fmt::format("link: '{}' and '{}' both have episode {}, and shards have none in common; `etude "
                                "dataset merge` makes one of datasets that have the same episodes",
                                found->second->path.string(), shard.path.string(), index));
    }
  return shard_of;
}

tl::unexpected<Error> OtherFilesystem(const Path& from, const Path& to) {
  return Fail(Code::kInvalidArgument,
              fmt::format("link '{}' to '{}': they lie on different filesystems, and hard links do not reach across. "
                          "Name an --out on the filesystem of the shards (copy a shard that lies elsewhere there "
                          "first), or copy all with `etude dataset merge`; `etude train --data A B` needs neither",
                          from.string(), to.string()));
}

// The device of `path`, or of the nearest folder above it that is there.
std::optional<dev_t> DeviceOf(const Path& path) {
  struct stat info {};
  std::error_code error;
  for (Path at = std::filesystem::absolute(path, error).lexically_normal();; at = at.parent_path()) {
    if (::stat(at.c_str(), &info) == 0) return info.st_dev;
    if (at == at.parent_path()) return std::nullopt;
  }
}

// Before anything is made, so that nothing is left behind.
Status CheckOneFilesystem(const std::vector<LinkedShard>& shards, const Path& out) {
  for (const LinkedShard& shard : shards)
    if (DeviceOf(shard.path / internal::kEpisodes) != DeviceOf(out)) return OtherFilesystem(shard.path, out);
  return {};
}

Status LinkEpisode(const Path& from, const Path& to) {
  ETUDE_RETURN_IF_ERROR(MakeFolders(to.parent_path()));
  const int error_number = internal::HardLink(from, to);
  if (error_number == 0) return {};
  if (error_number == EXDEV) return OtherFilesystem(from, to);
  Error failed = ErrnoError("make a hard link to", from, error_number);
  failed.message += "; where there can be none, `etude dataset merge` copies";
  return Fail(std::move(failed));
}

// Of what the shard has, and of what none has: given up, or not made yet.
std::set<std::uint64_t> AttemptedIndices(const LinkedShard& shard, const ShardOf& shard_of) {
  std::set<std::uint64_t> indices(shard.indices.begin(), shard.indices.end());
  ForEachAttempt(shard.path, [&](const AttemptLine& line) {
    if (!shard_of.contains(line.index)) indices.insert(line.index);
  });
  return indices;
}

Status LinkEpisodes(const std::vector<LinkedShard>& shards, std::uint64_t total, const Path& to,
                    const EditProgress& progress) {
  std::uint64_t done = 0;
  for (const LinkedShard& shard : shards)
    for (const std::uint64_t index : shard.indices) {
      ETUDE_RETURN_IF_ERROR(internal::CheckNotStopped(done, total, to));
      ETUDE_RETURN_IF_ERROR(LinkEpisode(EpisodePath(shard.path, index), EpisodePath(to, index)));
      ++done;
      if (progress) progress(done, total);
    }
  return internal::SyncEpisodeFolders(to);
}

Status FillLinked(const std::vector<LinkedShard>& shards, const ShardOf& shard_of, const CampaignSpec& spec,
                  const Path& to, const EditProgress& progress) {
  std::vector<internal::EpisodeSource> attempted, committed;
  for (const LinkedShard& shard : shards) {
    attempted.push_back({shard.path, AttemptedIndices(shard, shard_of)});
    committed.push_back({shard.path, {shard.indices.begin(), shard.indices.end()}});
  }
  ETUDE_RETURN_IF_ERROR(internal::CopyDescription(shards.front().path, to));
  ETUDE_RETURN_IF_ERROR(internal::CopyAttempts(attempted, to));
  ETUDE_RETURN_IF_ERROR(internal::CopyFilterKeys(committed, to));
  ETUDE_RETURN_IF_ERROR(internal::CopyCommits(committed, to));
  ETUDE_RETURN_IF_ERROR(LinkEpisodes(shards, shard_of.size(), to, progress));
  // as a collector that goes on does: statistics and master file come from the journal, not from the episodes
  ETUDE_ASSIGN_OR_RETURN(auto writer, DatasetWriter::Open(to, spec));
  return writer.WriteMaster();
}

}  // namespace

Result<LinkReport> LinkDatasets(const std::vector<Path>& datasets, const Path& out, Leftover leftover,
                                const EditProgress& progress, const EditFinish& finish) {
  if (datasets.size() < 2)
    return Fail(Code::kInvalidArgument, fmt::format("link {} dataset(s): name at least two", datasets.size()));
  std::vector<LinkedShard> shards;
  for (const Path& dataset : datasets) {
    ETUDE_ASSIGN_OR_RETURN(auto shard, OpenShard(dataset));
    shards.push_back(std::move(shard));
  }
  CampaignSpec spec = shards.front().spec;
  for (const LinkedShard& shard : shards) {
    ETUDE_RETURN_IF_ERROR(CheckOneCampaign(shards.front(), shard));
    spec.episodes = std::max(spec.episodes, shard.spec.episodes);
  }
  ETUDE_RETURN_IF_ERROR(internal::CheckOneJournal(datasets, "link"));
  ETUDE_ASSIGN_OR_RETURN(const ShardOf shard_of, AssignEpisodes(shards));
  ETUDE_RETURN_IF_ERROR(CheckOneFilesystem(shards, out));
  ETUDE_ASSIGN_OR_RETURN(auto folder, OutputFolder::Create(out, leftover));
  ETUDE_RETURN_IF_ERROR(FillLinked(shards, shard_of, spec, folder.path(), progress));
  // what was chosen of others, or imported, no campaign goes on with here either
  if (std::ranges::any_of(datasets, [](const Path& dataset) { return IsDerived(dataset); }))
    ETUDE_RETURN_IF_ERROR(MarkDerived(folder.path()));
  if (finish) ETUDE_RETURN_IF_ERROR(finish(folder.path()));
  ETUDE_RETURN_IF_ERROR(folder.Commit());
  return LinkReport{shard_of.size(), spec.episodes};
}

}  // namespace etude::store
