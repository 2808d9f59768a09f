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
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "services/episode/episode.h"
#include "services/policy/insight_file.h"
#include "services/policy/policy_types.h"

namespace etude::cli {

/// Looks into the policy, e.g. by policy::InsightClient.
using InsightFunction = std::function<Result<policy::Insight>(const policy::Question&)>;

using DecisionInsights = policy::InsightsByStep;

/// How many decisions have their insight, and why others have none.
struct InsightTally {
  std::uint64_t decisions = 0, shown = 0;
  std::uint64_t unpictured = 0;        ///< no picture was recorded at their control step
  std::uint64_t other_checkpoint = 0;  ///< decided by another checkpoint than the one that is served now
  std::uint64_t unanswered = 0;        ///< late, refused, or nobody serves the policy any more
  std::string problem;                 ///< the first of the unanswered ones' errors

  /// "overlay: 410 of 420 decisions; without: 8 by another checkpoint than the one that is served now, ..."
  /// @param what  the insights are for
  std::string Text(const std::string& what = "overlay") const;
};

/// Asks for every decision that Episode::details has, one after the other, and adds to `tally`.
/// @error kCorrupt: a picture of the rollout
Result<DecisionInsights> AskInsights(const Episode& rollout, const InsightFunction& ask, InsightTally& tally);

/// Writes FOLDER/<index>.insights (policy::InsightFile) of each recorded rollout that has none yet; files that are
/// there are kept. A rollout none of whose decisions has an insight gets no file, so that a later run asks again. A
/// stop request ends it before the next file.
/// @param ask  empty: nobody is asked, and those that are there are all
/// @returns the files. @error of the store; of the disk
Result<std::vector<Path>> WriteInsights(const Path& rollouts, const Path& folder, const InsightFunction& ask,
                                        InsightTally& tally);

}  // namespace etude::cli
