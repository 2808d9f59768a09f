// SPDX-License-Identifier: Apache-2.0
// A dataset on disk made of synthetic episodes.
#pragma once

#include <gtest/gtest.h>

#include "services/store/dataset.h"
#include "tests/support/synthetic_episode.h"

namespace etude {

/// Commits episodes [first, last) of `spec`.
inline void AddSyntheticEpisodes(const Path& folder, const CampaignSpec& spec, std::uint64_t first, std::uint64_t last,
                                 int steps = 50) {
  auto writer = store::DatasetWriter::Open(folder, spec);
  ASSERT_TRUE(writer) << writer.error().message;
  for (std::uint64_t i = first; i < last; ++i) {
    const Status committed = writer->Commit(MakeSyntheticEpisode(spec, i, steps));
    ASSERT_TRUE(committed) << committed.error().message;
  }
}

}  // namespace etude
