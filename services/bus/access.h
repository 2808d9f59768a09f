// SPDX-License-Identifier: Apache-2.0
// Which role may write and read which topic, where: what `etude security issue` puts into an identity's permissions.
// Each topic says it beside its name and QoS (wire.h), so there is none without.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/security/role.h"

namespace etude::bus {

/// The partitions that a topic lives in.
enum class Scope : std::uint8_t {
  kDirectory,  ///< "directory"
  kCampaign,   ///< CAMPAIGN/ID
  kEpisodes,   ///< CAMPAIGN/ID/episode
  kRun,        ///< RUN/ID
  kRelay,      ///< RUN/ID/relay: what another process passes on for a run
  kPlay,       ///< "play", and "play/SESSION"
  kDoctor,     ///< "doctor-...": a process talking to itself
};

/// A set of roles.
using RoleMask = std::uint32_t;
template <class... Roles>
constexpr RoleMask MaskOf(Roles... roles) {
  return ((RoleMask{1} << static_cast<unsigned>(roles)) | ... | RoleMask{0});
}
inline constexpr RoleMask kEveryRole = ~RoleMask{0};

struct Access {
  Scope scope = Scope::kDirectory;
  RoleMask publish = 0, subscribe = 0;
};

struct TopicAccess {
  std::string topic;
  Access access;
};

/// Every topic of the bus; one with two scopes stands twice.
std::vector<TopicAccess> TopicAccesses();
/// True for the topics in that table: others cannot be opened.
bool IsKnownTopic(const std::string& topic);

/// All that `roles` may do in these campaigns and runs (by name; none: in all). Evaluations are campaigns and runs
/// "eval-..." of their own, which belong to everybody who has a campaign or a run.
std::vector<security::Grant> GrantsFor(const std::vector<security::Role>& roles,
                                       const std::vector<std::string>& campaigns, const std::vector<std::string>& runs);

}  // namespace etude::bus
