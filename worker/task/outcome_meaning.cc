// SPDX-License-Identifier: Apache-2.0
#include "worker/task/outcome_meaning.h"

#include "services/core/enum_name.h"

namespace etude::task {

std::string_view Meaning(AttemptOutcome outcome) {
  return EnumName(outcome,
                  {{AttemptOutcome::kSuccess, "the judge says that the task is done"},
                   {AttemptOutcome::kSceneInvalid, "objects could not be placed, or did not settle"},
                   {AttemptOutcome::kPlanFailed, "no motion was found; the details say in which stage, and why"},
                   {AttemptOutcome::kGraspMissed, "the fingers closed without the object"},
                   {AttemptOutcome::kDropped, "the object was held, then lost"},
                   {AttemptOutcome::kCriterionFailed, "all stages ran, and the judge says no"},
                   {AttemptOutcome::kCollision, "the robot, or the target, touched what it had to avoid"},
                   {AttemptOutcome::kViolation, "the robot touched itself, or went beyond a joint's speed or torque"},
                   {AttemptOutcome::kTimeout, "it took longer than the limit of steps"},
                   {AttemptOutcome::kUnstable, "the simulation warned that its numbers are not sound"},
                   {AttemptOutcome::kPolicyError, "in a rollout: the policy refused, or did not answer"},
                   {AttemptOutcome::kStopped, "whoever watches stopped it"}},
                  "unknown");
}

}  // namespace etude::task
