// SPDX-License-Identifier: Apache-2.0
// Two evaluations of the same scenes, rollout by rollout: which of them succeeded where, and whether that can be
// chance.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/file.h"
#include "services/core/result.h"
#include "services/spec/campaign_spec.h"

namespace etude::campaign {

/// Keys of two campaigns that make other scenes, as "seed (1, now 2)"; none when they have the same. Which policy
/// drives, and how (rollout.* but for the sentences, image_stride, the size of the pictures), makes no other scene.
std::vector<std::string> SceneDifferences(const CampaignSpec& first, const CampaignSpec& second);
/// @error kInvalidArgument: SceneDifferences has some, and which. @param other  what to call `second` in the message
Status CheckSameScenes(const CampaignSpec& first, const CampaignSpec& second, const std::string& other);

/// What scenes and verdicts depend on beside the spec (EvalRules), as SceneDifferences has it; none where one of the
/// two reports is of an earlier version, which does not say.
std::vector<std::string> RuleDifferences(const OrderedJson& first, const OrderedJson& second);
/// @error kInvalidArgument: RuleDifferences has some, and which. @param other  what to call `second` in the message
Status CheckSameRules(const OrderedJson& first, const OrderedJson& second, const std::string& other);

/// Rollouts of one task, or of all, by both evaluations and one criterion.
struct PairedCounts {
  std::uint64_t both = 0, only_first = 0, only_second = 0, neither = 0;

  std::uint64_t n() const { return both + only_first + only_second + neither; }
};

/// Pairs the rollouts of two reports (eval.json) by their index. Those that only one of them has do not count.
/// @returns {"first", "second": their runs, "n", "unpaired", "per_task": [...], "overall": {...}, "overall_latched":
/// {...}}, each of the latter {"task", "n", "both", "only_first", "only_second", "neither", "share_first",
/// "share_second", "p": McNemarExactP}
/// @error kInvalidArgument: a rollout of both has another seed, task or target; kCorrupt: not a report
Result<OrderedJson> CompareReports(const OrderedJson& first, const OrderedJson& second);

struct Evaluation {
  CampaignSpec spec;
  OrderedJson report;  ///< eval.json
};
/// A folder that `etude eval` wrote. Its eval.json is enough: rollouts are read only where the report does not say its
/// spec. @error kNotFound, kCorrupt: it is not an evaluation's
Result<Evaluation> ReadEvaluation(const Path& folder);

/// CompareReports of two such folders, whose scenes and rules are compared first.
/// @error as CheckSameScenes, CheckSameRules, CompareReports and ReadEvaluation
Result<OrderedJson> CompareEvaluations(const Path& first, const Path& second);

/// As a table. @param comparison  of CompareReports
std::string ComparisonText(const OrderedJson& comparison);

}  // namespace etude::campaign
