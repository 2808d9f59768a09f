// SPDX-License-Identifier: Apache-2.0
// How an attempt ended.
#pragma once

#include <string>
#include <string_view>

namespace etude::task {

/// Why an attempt ended; the string forms are stable (attempts.jsonl, telemetry).
enum class AttemptOutcome {
  kSuccess,
  kSceneInvalid,     ///< objects could not be placed, or did not settle
  kPlanFailed,       ///< details say which stage and why (plan::OutcomeKind)
  kGraspMissed,      ///< fingers closed without the object
  kDropped,          ///< held, then lost
  kCriterionFailed,  ///< all stages ran, the judge says no
  kCollision,        ///< the robot, or the target, touched what it had to avoid
  kViolation,        ///< the robot touched itself, or went beyond a joint's speed or torque
  kTimeout,          ///< longer than the step limit
  kUnstable,         ///< the simulation warned
  kPolicyError,      ///< rollout: the policy refused or did not answer
  kStopped,          ///< whoever watches stopped it (RecordConfig::go_on)
};
std::string_view ToString(AttemptOutcome outcome);

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
