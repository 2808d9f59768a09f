// SPDX-License-Identifier: Apache-2.0
#include "services/store/master_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>
#include <vector>

#include "services/store/episode_file.h"
#include "services/store/hdf.h"
#include "services/store/layout.h"

namespace etude::store::internal {
namespace {

constexpr std::string_view kLanguageMask = "lang_";

Result<std::vector<std::uint8_t>> MasterBytes(const CampaignSpec& spec, const std::string& spec_sha256,
                                              const std::vector<MasterEntry>& episodes, const FilterKeys& chosen) {
  HdfWriter file;
  std::int64_t total = 0;
  file.Group("/data");
  for (const auto& [index, samples, task] : episodes) {
    // relative to the master file's own folder, so that a dataset may be moved
    file.ExternalLink(DemoGroup(index), EpisodePath("", index).generic_string(), DemoGroup(index));
    total += static_cast<std::int64_t>(samples);
  }
  file.Attribute("/data", "total", total);
  file.Attribute("/data", "env_args", EnvArgs());
  file.Attribute("/data", "spec_sha256", spec_sha256);
  for (const auto& [name, demos] : MasksOf(spec, episodes, chosen)) file.FixedStrings("/mask/" + name, demos);
  return file.Finish();
}

}  // namespace

std::vector<MasterEntry> EntriesOf(const std::map<std::uint64_t, EpisodeSummary>& episodes) {
  std::vector<MasterEntry> entries;
  entries.reserve(episodes.size());
  for (const auto& [index, episode] : episodes) entries.push_back({index, episode.samples, &episode.task});
  return entries;
}

std::string LanguageMask(std::size_t n) { return fmt::format("{}{:04d}", kLanguageMask, n); }

bool IsLanguageMask(std::string_view name) {
  if (!name.starts_with(kLanguageMask) || name.size() == kLanguageMask.size()) return false;
  return std::ranges::all_of(name.substr(kLanguageMask.size()), [](char c) { return c >= '0' && c <= '9'; });
}

std::string MaskOfTask(std::string task) {
  std::replace(task.begin(), task.end(), '+', '_');
  return task;
}

std::map<std::string, std::vector<std::string>> MasksOf(const CampaignSpec& spec,
                                                        const std::vector<MasterEntry>& episodes,
                                                        const FilterKeys& chosen) {
  std::map<std::string, std::vector<std::string>> masks{{"train", {}}, {"valid", {}}, {"test", {}}};
  for (const auto& [index, samples, made_for] : episodes) {
    masks[SplitOf(spec, index)].push_back(DemoName(index));
    const std::string task = MaskOfTask(*made_for);
    if (IsPlainName(task)) masks[task].push_back(DemoName(index));
  }
  for (const auto& [name, indices] : chosen) {
    auto& demos = masks[name];
    demos.clear();  // a key of this name counts, also where a task has it
    for (const std::uint64_t index : indices)
      if (std::ranges::binary_search(episodes, index, {}, &MasterEntry::index)) demos.push_back(DemoName(index));
  }
  return masks;
}

bool MasterIsDue(std::uint64_t episodes, std::uint64_t written) {
  constexpr std::uint64_t kFew = 1000;
  if (episodes <= written) return false;
  return episodes <= kFew || episodes - written >= written / 4;
}

Status WriteMasterFile(const Path& dataset, const CampaignSpec& spec, const std::string& spec_sha256,
                       const std::vector<MasterEntry>& episodes) {
  // keys that cannot be read keep no collector from its work; whoever reads or changes them is told
  const FilterKeys chosen = ReadFilterKeys(dataset).value_or(FilterKeys());
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, MasterBytes(spec, spec_sha256, episodes, chosen));
  return WriteFileAtomically(dataset / kMasterFile, bytes);
}

}  // namespace etude::store::internal
