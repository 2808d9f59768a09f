// SPDX-License-Identifier: Apache-2.0
// dataset.hdf5: one file that links to all episodes, with robomimic's filter keys. Internal to services/store.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "services/store/filter_keys.h"
#include "services/store/summary.h"

namespace etude::store::internal {

/// What the master file wants to know of an episode.
struct MasterEntry {
  std::uint64_t index = 0, samples = 0;
  const std::string* task = nullptr;
};
/// In the order of indices; they point into `episodes`.
std::vector<MasterEntry> EntriesOf(const std::map<std::uint64_t, EpisodeSummary>& episodes);

/// The name that a task's filter key has: "push_obstacle" of push+obstacle. It need not be plain: a path has no key.
std::string MaskOfTask(std::string task);
/// Key of the demonstrations of the n-th sentence in an exported file, "lang_0007"; whether a name is one of those.
std::string LanguageMask(std::size_t n);
bool IsLanguageMask(std::string_view name);

/// robomimic's filter keys: train, valid, test, each task, and `chosen`. Name -> "demo_<i>", in the order of indices,
/// in which `episodes` must be.
std::map<std::string, std::vector<std::string>> MasksOf(const CampaignSpec& spec,
                                                        const std::vector<MasterEntry>& episodes,
                                                        const FilterKeys& chosen);

/// Whether a dataset that grows is worth another master file: up to a thousand episodes with each new one, beyond that
/// when a quarter has come since. So all that are ever written have at most five links for each episode beyond the
/// first thousand.
/// @param episodes  there now   @param written  in the master file
bool MasterIsDue(std::uint64_t episodes, std::uint64_t written);

/// Rewrites DATASET/dataset.hdf5 by rename: /data/demo_<i> as external links into the episodes'
/// files, /mask/{train,valid,test}, /mask/<task> and the dataset's own filter keys as fixed-length byte strings.
/// @param spec_sha256  as the dataset says it (DatasetReader::spec_sha256): here its spec may have another one
Status WriteMasterFile(const Path& dataset, const CampaignSpec& spec, const std::string& spec_sha256,
                       const std::vector<MasterEntry>& episodes);

}  // namespace etude::store::internal
