// SPDX-License-Identifier: Apache-2.0
// How an attempt ended.
#pragma once

#include <array>
#include <string>
#include <string_view>

namespace etude::task {

/// Why an attempt ended (Meaning says it in words); the string forms are stable (attempts.jsonl, telemetry).
enum class AttemptOutcome {
  kSuccess,
  kSceneInvalid,
  kPlanFailed,
  kGraspMissed,
  kDropped,
  kCriterionFailed,
  kCollision,
  kViolation,
  kTimeout,
  kUnstable,
  kPolicyError,
};
/// In the order of their numbers.
inline constexpr std::array kAttemptOutcomes{
    AttemptOutcome::kSuccess,     AttemptOutcome::kSceneInvalid, AttemptOutcome::kPlanFailed,
    AttemptOutcome::kGraspMissed, AttemptOutcome::kDropped,      AttemptOutcome::kCriterionFailed,
    AttemptOutcome::kCollision,   AttemptOutcome::kViolation,    AttemptOutcome::kTimeout,
    AttemptOutcome::kUnstable,    AttemptOutcome::kPolicyError};
std::string_view ToString(AttemptOutcome outcome);
/// "fingers closed without the object"
std::string_view Meaning(AttemptOutcome outcome);

struct Verdict {
  AttemptOutcome outcome = AttemptOutcome::kSuccess;
  std::string reason;
  std::string stage = {};  ///< in which it ended, where that is not the one of the last step; "": that one
  bool ok() const { return outcome == AttemptOutcome::kSuccess; }
};

class Judge;
/// kCollision or kViolation and which was the first, or success when there is none.
Verdict VerdictOnViolations(const Judge& judge);

}  // namespace etude::task
