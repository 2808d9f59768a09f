// SPDX-License-Identifier: Apache-2.0
// How an attempt may end, in words.
#pragma once

#include <array>
#include <string_view>

#include "worker/task/verdict.h"

namespace etude::task {

/// In the order of their numbers.
inline constexpr std::array kAttemptOutcomes{
    AttemptOutcome::kSuccess,     AttemptOutcome::kSceneInvalid, AttemptOutcome::kPlanFailed,
    AttemptOutcome::kGraspMissed, AttemptOutcome::kDropped,      AttemptOutcome::kCriterionFailed,
    AttemptOutcome::kCollision,   AttemptOutcome::kViolation,    AttemptOutcome::kTimeout,
    AttemptOutcome::kUnstable,    AttemptOutcome::kPolicyError,  AttemptOutcome::kStopped};

/// For people: "the fingers closed without the object".
std::string_view Meaning(AttemptOutcome outcome);

}  // namespace etude::task
