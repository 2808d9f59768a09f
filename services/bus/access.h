// SPDX-License-Identifier: Apache-2.0
// Which role may write and read which topic, where: what `etude security issue` puts into an identity's permissions.
// Each topic says it beside its name and QoS (wire.h), so there is none without.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/security/role.h"

namespace etude::bus {

/// The partition of who is there and what they do, whatever campaigns and runs they have to do with.
inline constexpr char kDirectoryPartition[] = "directory";

/// The partitions that a topic lives in.
enum class Scope : std::uint8_t {
  kDirectory,     ///< kDirectoryPartition
  kCampaign,      ///< CAMPAIGN/ID
  kEpisodes,      ///< CAMPAIGN/ID/episode
  kRun,           ///< RUN/ID
  kRelay,         ///< RUN/ID/relay: what another process passes on for a run
  kPlay,          ///< "play", and "play/SESSION"
  kDoctor,        ///< "doctor-...": a process talking to itself
  kCampaignHost,  ///< CAMPAIGN/ID/HOST and CAMPAIGN/ID/episode/HOST: to one host's identity (kOfOneHost)
  kRunHost,       ///< RUN/ID/HOST
};

/// A set of roles.
using RoleMask = std::uint32_t;
template <class... Roles>
constexpr RoleMask MaskOf(Roles... roles) {
  return ((RoleMask{1} << static_cast<unsigned>(roles)) | ... | RoleMask{0});
}
inline constexpr RoleMask kEveryRole = ~RoleMask{0};

/// Roles of processes that belong to one host. Of what is meant for a host they read what is meant for theirs, which is
/// known by their identity's name; other roles read what is meant for any.
inline constexpr RoleMask kOfOneHost = MaskOf(security::Role::kWorker, security::Role::kRobot);

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

/// All that `roles` may do in these campaigns and runs (by name; none: in all), under an identity of the name `host`.
/// Evaluations are campaigns and runs "eval-..." of their own, which belong to everybody who has a campaign or a run;
/// so do the runs "play-..." of what `etude play open --checkpoint` serves.
std::vector<security::Grant> GrantsFor(const std::vector<security::Role>& roles, const std::string& host,
                                       const std::vector<std::string>& campaigns, const std::vector<std::string>& runs);

}  // namespace etude::bus
