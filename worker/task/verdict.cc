// SPDX-License-Identifier: Apache-2.0
#include "worker/task/verdict.h"

#include <fmt/format.h>

#include "services/core/enum_name.h"
#include "services/spec/attempt_outcome.h"
#include "worker/task/judge.h"

namespace etude::task {

std::string_view ToString(AttemptOutcome outcome) {
  return EnumName(outcome,
                  {{AttemptOutcome::kSuccess, "success"},
                   {AttemptOutcome::kSceneInvalid, kSceneInvalid},
                   {AttemptOutcome::kPlanFailed, "plan_failed"},
                   {AttemptOutcome::kGraspMissed, "grasp_missed"},
                   {AttemptOutcome::kDropped, "dropped"},
                   {AttemptOutcome::kCriterionFailed, "criterion_failed"},
                   {AttemptOutcome::kCollision, "collision"},
                   {AttemptOutcome::kViolation, "violation"},
                   {AttemptOutcome::kTimeout, "timeout"},
                   {AttemptOutcome::kUnstable, "unstable"},
                   {AttemptOutcome::kPolicyError, kPolicyError},
                   {AttemptOutcome::kStopped, "stopped"}},
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
