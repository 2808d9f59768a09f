// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "services/store/summary.h"

namespace etude::store::internal {

/// Rewrites DATASET/dataset.hdf5 by rename: /data/demo_<i> as external links into the episodes'
/// files, /mask/{train,valid,test} and /mask/<task> as fixed-length byte strings.
Status WriteMasterFile(const Path& dataset, const CampaignSpec& spec,
                       const std::map<std::uint64_t, EpisodeSummary>& episodes);

}  // namespace etude::store::internal
