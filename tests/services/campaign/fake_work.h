// SPDX-License-Identifier: Apache-2.0
// What a fake worker does: a pure function of (spec, sampling weights, index, attempt), with failures.
#pragma once

#include "services/campaign/worker_client.h"
#include "services/core/rng.h"
#include "services/episode/codec.h"
#include "services/spec/content_version.h"
#include "services/spec/episode_plan.h"
#include "tests/support/synthetic_episode.h"

namespace etude::campaign {

/// One attempt in four fails by its nature.
inline bool FakeFails(std::uint64_t index, std::uint32_t attempt) { return MixSeed({index, attempt}, "fake") % 4 == 0; }

inline Episode FakeEpisode(const CampaignSpec& spec, std::uint64_t index, std::uint32_t attempt,
                           const SamplingWeights& weights = {}) {
  Episode episode = MakeSyntheticEpisode(spec, index, 20);
  const EpisodePlan plan = PlanEpisode(spec, index, attempt, weights);
  episode.task = plan.task.text();
  if (!weights.empty()) episode.details["sampling"] = SamplingDetails(plan);
  episode.attempt = attempt;
  episode.seed = EpisodeSeed(spec, index, attempt);
  episode.version = std::to_string(kContentVersion);
  return episode;
}

inline WorkResult FakeAttempt(const CampaignSpec& spec, const WorkItem& item) {
  WorkResult result;
  if (FakeFails(item.index, item.attempt)) {
    result.outcome = "plan_failed";
  } else {
    result.episode = EncodeEpisode(FakeEpisode(spec, item.index, item.attempt, item.weights));
    result.times.plan_s = 0.25;
  }
  return result;
}

/// The attempt that a campaign must commit for `index`.
inline std::uint32_t FakeCommittedAttempt(std::uint64_t index) {
  std::uint32_t attempt = 0;
  while (FakeFails(index, attempt)) ++attempt;
  return attempt;
}

}  // namespace etude::campaign
