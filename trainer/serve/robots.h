// SPDX-License-Identifier: Apache-2.0
// Robots in a DDS domain of their own, with an authority of their own. The policy server alone is in both: of the
// robots' domain it takes observations, and of the other one checkpoints. Whoever has an identity of the collection's
// cannot speak to a robot, and a robot cannot speak to collectors and trainers.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "services/bus/participant.h"

namespace etude::serve {

struct RobotDomain {
  std::optional<std::uint32_t> domain;  ///< none: robots are where the run is
  std::string profile;                  ///< as ParticipantConfig::profile; empty: the run's
  std::string security;                 ///< folder of the policy server's identity among robots; role policy
};

/// What the run's domain is like.
struct RunDomain {
  std::uint32_t domain = 0;
  std::string security;   ///< "": anybody may join
  bool verifies = false;  ///< takes no checkpoints but signed ones, or one that lies in a file
};

/// Says what would let others into the robots' domain that must not be. Warns where anybody can publish checkpoints,
/// which would then drive them.
/// @error kInvalidArgument: both are one domain, or of one authority; a secured run and robots without security;
/// kNotFound and others of ReadTextFile: an identity without its authority's certificate
Status CheckRobotDomain(const RobotDomain& robots, const RunDomain& run);

/// Joins it; nothing where robots have no domain of their own.
/// @param profile  the run's   @error as bus::Participant::Open
Result<std::optional<bus::Participant>> JoinRobotDomain(const RobotDomain& robots, const std::string& profile);

}  // namespace etude::serve
