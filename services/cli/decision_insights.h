// SPDX-License-Identifier: Apache-2.0
// What the policy saw and said at each decision of a recorded rollout.
//
// Its server is asked again once the rollouts are over. The record has every bit of what the policy was asked (picture,
// joints, sentence, camera), and what it says is a function of that and of its checkpoint alone. While rollouts run
// nobody looks: they go on faster than a server shows itself, and a server that is looked into answers later, which a
// rollout feels (rollout.latency_ms).
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "services/core/result.h"
#include "services/episode/episode.h"
#include "services/policy/insight.h"
#include "services/policy/policy_types.h"

namespace etude::cli {

/// Looks into the policy, e.g. by policy::InsightClient.
using InsightFunction = std::function<Result<policy::Insight>(const policy::Question&)>;

/// By the control step of the decision; nothing for one that has none.
using DecisionInsights = std::map<int, std::optional<policy::Insight>>;

/// How many decisions have their insight, and why others have none.
struct InsightTally {
  std::uint64_t decisions = 0, shown = 0;
  std::uint64_t unpictured = 0;        ///< no picture was recorded at their control step
  std::uint64_t other_checkpoint = 0;  ///< decided by another checkpoint than the one that is served now
  std::uint64_t unanswered = 0;        ///< late, refused, or nobody serves the policy any more
  std::string problem;                 ///< the first of the unanswered ones' errors

  /// "overlay: 410 of 420 decisions; without: 8 by another checkpoint than the one that is served now, ..."
  std::string Text() const;
};

/// Asks for every decision that Episode::details has, one after the other, and adds to `tally`.
/// @error kCorrupt: a picture of the rollout
Result<DecisionInsights> AskInsights(const Episode& rollout, const InsightFunction& ask, InsightTally& tally);

}  // namespace etude::cli
