// SPDX-License-Identifier: Apache-2.0
#include "worker/task/verdict.h"

#include <fmt/format.h>

#include "worker/task/judge.h"

namespace etude::task {

std::string_view ToString(AttemptOutcome outcome) {
  switch (outcome) {
    case AttemptOutcome::kSuccess:
      return "success";
    case AttemptOutcome::kSceneInvalid:
      return "scene_invalid";
    case AttemptOutcome::kPlanFailed:
      return "plan_failed";
    case AttemptOutcome::kGraspMissed:
      return "grasp_missed";
    case AttemptOutcome::kDropped:
      return "dropped";
    case AttemptOutcome::kCriterionFailed:
      return "criterion_failed";
    case AttemptOutcome::kCollision:
      return "collision";
    case AttemptOutcome::kViolation:
      return "violation";
    case AttemptOutcome::kTimeout:
      return "timeout";
    case AttemptOutcome::kUnstable:
      return "unstable";
    case AttemptOutcome::kPolicyError:
      return "policy_error";
  }
  return "unknown";
}

Verdict VerdictOnViolations(const Judge& judge) {
  if (judge.violations().empty()) return {};
  const Violation& first = judge.violations().front();
  const bool contact = first.kind == Violation::Kind::kContact;
  return {contact ? AttemptOutcome::kCollision : AttemptOutcome::kViolation,
          fmt::format("step {}: {} of {} ({:.4f})", first.step, ToString(first.kind), first.what, first.worst)};
}

}  // namespace etude::task
