// SPDX-License-Identifier: Apache-2.0
// What the report of an evaluation says of occlusion, of pushes of the target and of written sentences; nothing where
// a campaign has none of them.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "services/campaign/eval_report.h"

namespace etude::campaign {

/// Adds to `report`, each only where the spec asks for it:
/// "occlusion": {"share": asked for, "covered": mean over rollouts};
/// "pushes": {"asked", "made", "missed", "rollouts": pushed at least once, "success": of those, as ShareJson,
/// "not_pushed": n, "success_not_pushed"};
/// "per_sentence": [{"text", "task", "object", "reference", "n", "success", "success_latched"}], in the spec's order
/// ("reference" of relations only).
void AddSuites(const CampaignSpec& spec, const std::map<std::uint64_t, RolloutRow>& rows, OrderedJson& report);

/// A line each of occlusion and pushes, below the table of an evaluation; "" without. Sentences: see SentencesText.
std::string SuitesText(const OrderedJson& report);

/// A row a sentence: successes of scenes by both criteria, what it means, and, where the report has "never_seen" for
/// it, the words that training never said; "" without sentences.
std::string SentencesText(const OrderedJson& report);

}  // namespace etude::campaign
