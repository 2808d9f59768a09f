// SPDX-License-Identifier: Apache-2.0
#include "services/store/master_file.h"

#include <algorithm>
#include <vector>

#include "services/store/episode_file.h"
#include "services/store/hdf.h"
#include "services/store/layout.h"

namespace etude::store::internal {
namespace {

Result<std::vector<std::uint8_t>> MasterBytes(const CampaignSpec& spec,
                                              const std::map<std::uint64_t, EpisodeSummary>& episodes) {
  HdfWriter file;
  std::map<std::string, std::vector<std::string>> masks{{"train", {}}, {"valid", {}}, {"test", {}}};
  std::int64_t total = 0;
  file.Group("/data");
  for (const auto& [index, episode] : episodes) {
    const std::string group = DemoGroup(index);
    const std::string name = group.substr(group.rfind('/') + 1);
    // relative to the master file's own folder, so that a dataset may be moved
    file.ExternalLink(group, EpisodePath("", index).generic_string(), group);
    masks[SplitOf(spec, index)].push_back(name);
    std::string task = episode.task;
    std::replace(task.begin(), task.end(), '+', '_');
    if (IsPlainName(task)) masks[task].push_back(name);
    total += static_cast<std::int64_t>(episode.samples);
  }
  file.Attribute("/data", "total", total);
  file.Attribute("/data", "env_args", EnvArgs());
  file.Attribute("/data", "spec_sha256", SpecHash(spec));
  for (const auto& [name, demos] : masks) file.FixedStrings("/mask/" + name, demos);
  return file.Finish();
}

}  // namespace

Status WriteMasterFile(const Path& dataset, const CampaignSpec& spec,
                       const std::map<std::uint64_t, EpisodeSummary>& episodes) {
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, MasterBytes(spec, episodes));
  return WriteFileAtomically(dataset / kMasterFile, bytes);
}

}  // namespace etude::store::internal
