// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "services/store/filter_keys.h"
#include "services/store/summary.h"

namespace etude::store::internal {

/// robomimic's filter keys: train, valid, test, each task, and `chosen`. Name -> "demo_<i>", in the episodes' order.
std::map<std::string, std::vector<std::string>> MasksOf(const CampaignSpec& spec,
                                                        const std::map<std::uint64_t, EpisodeSummary>& episodes,
                                                        const FilterKeys& chosen);

/// Rewrites DATASET/dataset.hdf5 by rename: /data/demo_<i> as external links into the episodes'
/// files, /mask/{train,valid,test}, /mask/<task> and the dataset's own filter keys as fixed-length byte strings.
Status WriteMasterFile(const Path& dataset, const CampaignSpec& spec,
                       const std::map<std::uint64_t, EpisodeSummary>& episodes);

}  // namespace etude::store::internal
