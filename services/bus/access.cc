// SPDX-License-Identifier: Apache-2.0
#include "services/bus/access.h"

#include <algorithm>

#include "services/bus/wire.h"

namespace etude::bus {
namespace {

using security::Role;

// The partitions of a scope, as patterns. "NAME/*" and never "NAME*": that would let a campaign "ab" into "a".
std::vector<std::string> PartitionsOf(Scope scope, const std::vector<std::string>& campaigns,
                                      const std::vector<std::string>& runs) {
  if (scope == Scope::kDirectory) return {"directory"};
  if (scope == Scope::kPlay) return {"play", "play/*"};
  if (scope == Scope::kDoctor) return {"doctor-*"};
  const bool of_run = scope == Scope::kRun || scope == Scope::kRelay;
  const std::string end = scope == Scope::kEpisodes ? "/*/episode" : scope == Scope::kRelay ? "/*/relay" : "/*";
  const auto& names = of_run ? runs : campaigns;
  std::vector<std::string> partitions;
  if (names.empty()) return {"*" + end};
  for (const auto& name : names) partitions.push_back(name + end);
  partitions.push_back("eval-*" + end);
  return partitions;
}

template <class Message>
TopicAccess AccessOf() {
  return {Traits<Message>::kTopic, Traits<Message>::kAccess};
}

}  // namespace

std::vector<TopicAccess> TopicAccesses() {
  constexpr Access kPublished{Scope::kRun, MaskOf(Role::kTrainer),
                              MaskOf(Role::kPolicy, Role::kSubscriber, Role::kRelay)};
  constexpr Access kRelayed{Scope::kRelay, MaskOf(Role::kRelay), MaskOf(Role::kPolicy, Role::kSubscriber)};
  std::vector<TopicAccess> accesses{{kPublishedManifestTopic, kPublished},
                                    {kPublishedChunkTopic, kPublished},
                                    {kPublishedManifestTopic, kRelayed},
                                    {kPublishedChunkTopic, kRelayed},
                                    {Traits<ProcessEvent>::kTopic, {Scope::kDoctor, kEveryRole, kEveryRole}}};
#define ETUDE_ACCESS(Name) accesses.push_back(AccessOf<Name>());
  ETUDE_MESSAGES(ETUDE_ACCESS)
#undef ETUDE_ACCESS
  std::ranges::stable_sort(accesses, {}, &TopicAccess::topic);
  return accesses;
}

bool IsKnownTopic(const std::string& topic) {
  static const std::vector<TopicAccess> accesses = TopicAccesses();
  return std::ranges::find(accesses, topic, &TopicAccess::topic) != accesses.end();
}

std::vector<security::Grant> GrantsFor(const std::vector<Role>& roles, const std::vector<std::string>& campaigns,
                                       const std::vector<std::string>& runs) {
  RoleMask mask = 0;
  for (const Role role : roles) mask |= MaskOf(role);
  std::vector<security::Grant> grants;
  for (const auto& [topic, access] : TopicAccesses())
    for (const auto& partition : PartitionsOf(access.scope, campaigns, runs)) {
      if ((access.publish & mask) != 0) grants.push_back({true, topic, partition});
      if ((access.subscribe & mask) != 0) grants.push_back({false, topic, partition});
    }
  return grants;
}

}  // namespace etude::bus
