// SPDX-License-Identifier: Apache-2.0
#include "services/spec/attempt_outcome.h"

#include "services/spec/campaign_spec.h"

namespace etude {

Retry RetryOf(const CampaignSpec& spec, const std::string& outcome) {
  if (outcome == kPolicyError || outcome == kRecheckMismatch) return Retry::kSameAttempt;
  // a rollout's scene is a function of its index: another attempt would be the same
  if ((outcome == kSceneInvalid || outcome == kKillsWorkers) && spec.mode == "rollout") return Retry::kNever;
  return Retry::kNextAttempt;
}

}  // namespace etude
