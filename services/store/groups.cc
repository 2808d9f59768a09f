// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <set>

#include "services/core/rng.h"
#include "services/store/edit.h"

namespace etude::store {
namespace {

Result<std::string> ValueOf(const CampaignSpec& spec, const Episode& episode, const std::string& by) {
  if (by == "robot") return episode.robot;
  if (by == "task") return episode.task;
  if (by == "target") return episode.target;
  if (by == "split") return SplitOf(spec, episode.index);
  if (by == "outcome") return episode.outcome;
  return Fail(Code::kInvalidArgument, fmt::format("split by '{}': say robot, task, target, split or outcome", by));
}

// A robot or task may be a path: the file's name without its ending stands for it.
std::string FolderName(const std::string& value) {
  std::string name = Path(value).stem().string();
  std::replace_if(
      name.begin(), name.end(), [](char c) { return std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '-'; },
      '_');
  return name.empty() ? "none" : name;
}

Status CheckParts(const std::vector<PartShare>& parts) {
  std::set<std::string> names;
  for (const auto& part : parts)
    if (!IsPlainName(part.name) || !names.insert(part.name).second || !(part.share > 0) || !std::isfinite(part.share))
      return Fail(Code::kInvalidArgument,
                  fmt::format("part '{}' of share {}: names are plain (a-z, 0-9, _ and -) and different, shares "
                              "positive",
                              part.name, part.share));
  if (parts.empty()) return Fail(Code::kInvalidArgument, "split into no parts: name at least one");
  return {};
}

}  // namespace

Result<Groups> GroupEpisodes(const Path& dataset, const std::string& by) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, DatasetReader::Open(dataset));
  ETUDE_ASSIGN_OR_RETURN(const auto indices, reader.List());
  std::map<std::string, std::vector<std::uint64_t>> of_value;
  for (const std::uint64_t index : indices) {
    ETUDE_RETURN_IF_ERROR(internal::CheckNotStopped(dataset));
    ETUDE_ASSIGN_OR_RETURN(const auto record, reader.Read(index));
    ETUDE_ASSIGN_OR_RETURN(const std::string value, ValueOf(reader.spec(), record.episode, by));
    of_value[value].push_back(index);
  }
  // files of one name in two folders are two robots
  Groups groups;
  for (auto& [value, episodes] : of_value) {
    const std::string name = FolderName(value);
    std::string free = name;
    for (int i = 2; groups.contains(free); ++i) free = fmt::format("{}_{}", name, i);
    groups[free] = std::move(episodes);
  }
  if (groups.empty()) return Fail(Code::kNotFound, fmt::format("split '{}': it has no episodes", dataset.string()));
  return groups;
}

Result<Groups> DealEpisodes(const Path& dataset, const std::vector<PartShare>& parts) {
  ETUDE_RETURN_IF_ERROR(CheckParts(parts));
  ETUDE_ASSIGN_OR_RETURN(const auto reader, DatasetReader::Open(dataset));
  ETUDE_ASSIGN_OR_RETURN(auto indices, reader.List());
  if (indices.empty()) return Fail(Code::kNotFound, fmt::format("split '{}': it has no episodes", dataset.string()));
  Rng rng(MixSeed({}, "deal episodes"));
  rng.Shuffle(indices);
  double total = 0, until = 0;
  for (const auto& part : parts) total += part.share;
  // the products below are at most this one
  if (!std::isfinite(static_cast<double>(indices.size()) * total))
    return Fail(Code::kInvalidArgument, "split: the shares add up to more than a number holds");
  Groups groups;
  std::size_t begin = 0;
  for (const auto& part : parts) {
    until += part.share;
    const auto end = static_cast<std::size_t>(std::llround(static_cast<double>(indices.size()) * until / total));
    auto& own = groups[part.name];
    own.assign(indices.begin() + static_cast<std::ptrdiff_t>(begin),
               indices.begin() + static_cast<std::ptrdiff_t>(end));
    std::sort(own.begin(), own.end());
    begin = end;
  }
  return groups;
}

}  // namespace etude::store
