// SPDX-License-Identifier: Apache-2.0
// What tests of the two clients ask, and of whom.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

#include "services/bus/directory.h"
#include "services/bus/participant.h"
#include "services/policy/policy_types.h"

namespace etude::policy {

/// Says that a policy server of this run is there.
inline bus::Announcement AnnounceServer(const bus::Participant& participant, const std::string& name,
                                        const std::string& id) {
  return bus::Announcement::Open(participant, bus::MakePresence(bus::PresenceKind::kPolicy, name, id, ""),
                                 Claim::kAdopt)
      .value();
}

class PolicyAsker : public testing::Test {
 protected:
  Question MakeQuestion(const std::string& instruction = "pick up the red can") const {
    Question question;
    question.instruction = instruction;
    question.joints = {0.1f, 0.2f};
    question.width = question.height = 4;
    question.rgb = picture_;
    return question;
  }

  std::vector<std::uint8_t> picture_ = std::vector<std::uint8_t>(48, 9);
  bus::Participant participant_ = bus::Participant::Open({77, ""}).value();
};

}  // namespace etude::policy
