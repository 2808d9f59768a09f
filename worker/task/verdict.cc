// SPDX-License-Identifier: Apache-2.0
#include "worker/task/verdict.h"

#include <fmt/format.h>

#include "services/core/enum_name.h"
#include "worker/task/judge.h"

namespace etude::task {

std::string_view ToString(AttemptOutcome outcome) {
  return EnumName(outcome,
                  {{AttemptOutcome::kSuccess, "success"},
                   {AttemptOutcome::kSceneInvalid, "scene_invalid"},
                   {AttemptOutcome::kPlanFailed, "plan_failed"},
                   {AttemptOutcome::kGraspMissed, "grasp_missed"},
                   {AttemptOutcome::kDropped, "dropped"},
                   {AttemptOutcome::kCriterionFailed, "criterion_failed"},
                   {AttemptOutcome::kCollision, "collision"},
                   {AttemptOutcome::kViolation, "violation"},
                   {AttemptOutcome::kTimeout, "timeout"},
                   {AttemptOutcome::kUnstable, "unstable"},
                   {AttemptOutcome::kPolicyError, "policy_error"}},
                  "unknown");
}

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
                   {AttemptOutcome::kPolicyError, "in a rollout: the policy refused, or did not answer"}},
                  "unknown");
}

Verdict VerdictOnViolations(const Judge& judge) {
  if (judge.violations().empty()) return {};
  const Violation& first = judge.violations().front();
  const bool contact = first.kind == Violation::Kind::kContact;
  return {contact ? AttemptOutcome::kCollision : AttemptOutcome::kViolation,
          fmt::format("step {}: {} of {} ({:.4f})", first.step, ToString(first.kind), first.what, first.worst)};
}

}  // namespace etude::task
