// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/attempt_outcome.cc
#include "services/spec/attempt_outcome.h"

#include <gtest/gtest.h>

#include "services/spec/campaign_spec.h"

namespace etude {
namespace attempt_outcome_test {

CampaignSpec SpecOf(const std::string& mode) {
  CampaignSpec spec;
  spec.mode = mode;
  return spec;
}

TEST(RetryOf, WhatAnotherAttemptWouldNotChangeIsTheEndOfARolloutAlone) {
  for (const char* outcome : {kSceneInvalid, kKillsWorkers}) {
    EXPECT_EQ(RetryOf(SpecOf("rollout"), outcome), Retry::kNever) << outcome;
    EXPECT_EQ(RetryOf(SpecOf("demonstrate"), outcome), Retry::kNextAttempt) << outcome;
  }
}

TEST(RetryOf, WhatIsNotTheAttemptsFailureIsTriedAgain) {
  for (const char* mode : {"demonstrate", "rollout"})
    for (const char* outcome : {kPolicyError, kRecheckMismatch})
      EXPECT_EQ(RetryOf(SpecOf(mode), outcome), Retry::kSameAttempt) << mode << " " << outcome;
}

TEST(RetryOf, AfterAnyOtherTheNextAttemptIsMade) {
  for (const char* mode : {"demonstrate", "rollout"})
    for (const char* outcome : {"plan_failed", "timeout", "", "of a later version"})
      EXPECT_EQ(RetryOf(SpecOf(mode), outcome), Retry::kNextAttempt) << mode << " " << outcome;
}

}  // namespace attempt_outcome_test
}  // namespace etude
