// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "services/store/dataset.h"
#include "services/store/episode_file.h"
#include "services/store/layout.h"

namespace etude::store {
namespace {

struct Loaded {
  std::vector<std::uint8_t> bytes;
  internal::EpisodeFile file;
};

Result<Loaded> Load(const Path& path, std::uint64_t index) {
  Loaded loaded;
  ETUDE_ASSIGN_OR_RETURN(loaded.bytes, ReadBinaryFile(path, internal::kMaxEpisodeFile));
  auto file = internal::DecodeEpisodeFile(loaded.bytes);
  if (!file) return Fail(file.error().Wrap(fmt::format("read '{}'", path.string())));
  loaded.file = std::move(*file);
  if (loaded.file.episode.index != index)
    return Fail(Code::kCorrupt,
                fmt::format("read '{}': it holds episode {}", path.string(), loaded.file.episode.index));
  return loaded;
}

}  // namespace

Result<DatasetReader> DatasetReader::Open(const Path& dataset) {
  auto description = internal::ReadDatasetFile(dataset);
  if (!description && description.error().code == Code::kNotFound)
    return Fail(Code::kNotFound, fmt::format("no dataset in '{}' (it has no dataset.json); `etude collect` makes one",
                                             dataset.string()));
  if (!description) return Fail(std::move(description).error());
  DatasetReader reader;
  reader.path_ = dataset;
  reader.spec_ = std::move(description->spec);
  reader.spec_sha256_ = std::move(description->spec_sha256);
  reader.schema_version_ = description->schema_version;
  reader.content_version_ = description->content;
  return reader;
}

Result<std::vector<std::uint64_t>> DatasetReader::List() const {
  ETUDE_ASSIGN_OR_RETURN(const auto files, internal::ListEpisodeFolder(path_));
  std::set<std::uint64_t> indices;  // beyond a million, paths do not sort as numbers do
  for (const auto& path : files)
    if (const auto index = internal::IndexOf(path)) indices.insert(*index);
  return std::vector<std::uint64_t>(indices.begin(), indices.end());
}

Result<EpisodeRecord> DatasetReader::Read(std::uint64_t index) const {
  const Path path = EpisodePath(path_, index);
  ETUDE_ASSIGN_OR_RETURN(auto loaded, Load(path, index));
  return EpisodeRecord{path, std::move(loaded.file.episode), std::move(loaded.file.frames)};
}

Result<Episode> DatasetReader::ReadWhole(std::uint64_t index) const {
  ETUDE_ASSIGN_OR_RETURN(auto loaded, Load(EpisodePath(path_, index), index));
  return internal::WithStreams(std::move(loaded.file), loaded.bytes);
}

}  // namespace etude::store
