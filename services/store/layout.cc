// SPDX-License-Identifier: Apache-2.0
#include "services/store/layout.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <set>
#include <utility>

#include "services/episode/bounded_json.h"
#include "services/spec/task_files.h"
#include "services/store/dataset.h"

namespace etude::store {

Path EpisodePath(const Path& dataset, std::uint64_t index) {
  return dataset / internal::kEpisodes / fmt::format("{:03d}", index / 1000) / fmt::format("{:06d}.hdf5", index);
}

}  // namespace etude::store

namespace etude::store::internal {
namespace {

namespace fs = std::filesystem;

tl::unexpected<Error> ListError(const Path& folder, const std::error_code& error) {
  return Fail(Code::kUnavailable, fmt::format("list '{}': {}", folder.string(), error.message()));
}

Result<std::vector<Path>> ListFolder(const Path& folder) {
  std::vector<Path> paths;
  std::error_code error;
  fs::directory_iterator it(folder, error);
  // a link that leads nowhere, whose disk is away, is no folder that is yet to be made
  if (std::error_code ignored; error == std::errc::no_such_file_or_directory && !fs::is_symlink(folder, ignored))
    return paths;
  for (; !error && it != fs::directory_iterator(); it.increment(error)) paths.push_back(it->path());
  if (error) return ListError(folder, error);
  std::sort(paths.begin(), paths.end());
  return paths;
}

// {"a": {"b": 1}} -> "a.b" -> 1; lists are values
void Flatten(const OrderedJson& json, const std::string& prefix,
             std::vector<std::pair<std::string, OrderedJson>>& out) {
  for (const auto& [key, value] : json.items()) {
    const std::string path = prefix.empty() ? key : prefix + "." + key;
    if (value.is_object())
      Flatten(value, path, out);
    else
      out.emplace_back(path, value);
  }
}

}  // namespace

std::optional<std::uint64_t> IndexOf(const Path& path) {
  const std::string stem = path.stem().string();
  std::uint64_t index = 0;
  const auto [end, error] = std::from_chars(stem.data(), stem.data() + stem.size(), index);
  if (error != std::errc() || end != stem.data() + stem.size()) return std::nullopt;
  const Path expected = EpisodePath("", index);
  if (path.filename() != expected.filename() || path.parent_path().filename() != expected.parent_path().filename())
    return std::nullopt;
  return index;
}

Result<std::vector<Path>> ListEpisodeFolder(const Path& dataset) {
  ETUDE_ASSIGN_OR_RETURN(const auto folders, ListFolder(dataset / kEpisodes));
  std::vector<Path> files;
  for (const auto& folder : folders) {
    if (folder.filename().string().starts_with('.')) continue;  // of editors and network file systems
    std::error_code error, ignored;
    const bool is_folder = fs::is_directory(folder, error);
    if (error == std::errc::no_such_file_or_directory && !fs::is_symlink(folder, ignored)) continue;  // gone since
    if (error) return ListError(folder, error);
    if (!is_folder) continue;
    ETUDE_ASSIGN_OR_RETURN(const auto paths, ListFolder(folder));
    files.insert(files.end(), paths.begin(), paths.end());
  }
  return files;
}

std::map<std::uint64_t, std::uint64_t> SizesOf(const std::vector<Path>& files) {
  std::map<std::uint64_t, std::uint64_t> sizes;
  for (const auto& path : files) {
    const auto index = IndexOf(path);
    if (!index) continue;
    std::error_code error;
    const auto bytes = fs::file_size(path, error);
    sizes[*index] = error ? 0 : bytes;
  }
  return sizes;
}

Result<FileLock> LockDataset(const Path& dataset) {
  return FileLock::Take(dataset / kLock, fmt::format("dataset '{}' is being written", dataset.string()));
}

namespace {

std::int64_t IntegerOr0(const OrderedJson& json, const char* key) {
  return json.contains(key) && json[key].is_number_integer() ? json[key].get<std::int64_t>() : 0;
}

}  // namespace

Result<DatasetFile> ReadDatasetFile(const Path& dataset) {
  const Path path = dataset / kDatasetJson;
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(path, 64 << 20));
  const OrderedJson json = ParseBoundedJson(text).value_or(OrderedJson());
  const auto corrupt = [&](const std::string& what) {
    return Fail(Code::kCorrupt, fmt::format("read '{}': {}", path.string(), what));
  };
  if (!json.is_object() || !json.contains("schema_version") || !json.contains("spec"))
    return corrupt("not a dataset's description");
  const auto& version = json["schema_version"];
  if (!version.is_number_integer()) return corrupt("schema_version is not a number");
  const auto schema = version.get<std::int64_t>();
  if (schema < kOldestSchema || schema > kSchemaVersion)
    return Fail(Code::kInvalidArgument,
                fmt::format("dataset '{}' has schema version {}, this program reads {} to {}; use the version of "
                            "Etude that made it",
                            dataset.string(), schema, kOldestSchema, kSchemaVersion));
  auto spec = FromJson<CampaignSpec>(json["spec"], path.string());
  if (!spec) return corrupt(spec.error().message);
  const auto hash = json.find("spec_sha256");
  if (hash == json.end() || !hash->is_string()) return corrupt("it has no spec_sha256");
  return DatasetFile{std::move(*spec), json.value("statistics", OrderedJson::object()), hash->get<std::string>(),
                     static_cast<int>(schema), IntegerOr0(json, "content")};
}

Status WriteDatasetFile(const Path& dataset, const DatasetFile& content) {
  const OrderedJson json = {{"schema_version", kSchemaVersion},
                            {"content", kContentVersion},
                            {"spec_sha256", SpecHash(content.spec)},
                            {"spec", ToJson(content.spec)},
                            {"statistics", content.statistics}};
  return WriteFileAtomically(dataset / kDatasetJson, JsonText(json, 2) + "\n");
}

std::string WhyClosed(const DatasetFile& found) {
  if (found.schema_version != kSchemaVersion)
    return fmt::format("has schema version {}, new episodes have {}: it can be read and trained on, but not added to",
                       found.schema_version, kSchemaVersion);
  if (found.content != kContentVersion)
    return fmt::format(
        "was made with content version {}, new episodes have {}: the same spec would not make the same bytes",
        found.content, kContentVersion);
  if (found.spec_sha256 != SpecHash(found.spec))
    return fmt::format("cannot be added to: {}; new episodes would not be of one spec with those in it",
                       WhyHashDiffers(found.spec));
  return "";
}

std::vector<std::string> SpecDifferences(const CampaignSpec& made_from, const CampaignSpec& now) {
  if (SpecHash(made_from) == SpecHash(now)) return {};
  std::vector<std::pair<std::string, OrderedJson>> before, after;
  Flatten(ToJson(made_from), "", before);
  Flatten(ToJson(now), "", after);
  std::vector<std::string> differences;
  for (std::size_t i = 0; i < std::min(before.size(), after.size()); ++i) {
    const auto& [key, value] = before[i];
    const bool free = key == "name" || key == "episodes" || key == "max_attempts" || key == "stall_timeout_s" ||
                      key == "determinism" || key == "recheck" || key == "device" ||
                      (key.starts_with("split.") && !now.adaptive_sampling.on());
    if (!free && value != after[i].second)
      differences.push_back(fmt::format("{} ({}, now {})", key, value.dump(), after[i].second.dump()));
  }
  return differences;
}

std::vector<std::string> DifferencesBesideHash(const CampaignSpec& first, const CampaignSpec& other) {
  std::vector<std::string> differences;
  if (first.name != other.name) differences.push_back(fmt::format("name ({}, now {})", first.name, other.name));
  const OrderedJson split = ToJson(first.split), other_split = ToJson(other.split);
  // with adaptive sampling it is part of the hash
  if (split != other_split && !first.adaptive_sampling.on())
    differences.push_back(fmt::format("split ({}, now {})", split.dump(), other_split.dump()));
  return differences;
}

}  // namespace etude::store::internal
