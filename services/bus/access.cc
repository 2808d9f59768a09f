// SPDX-License-Identifier: Apache-2.0
#include "services/bus/access.h"

#include <algorithm>
#include <string_view>
#include <utility>

#include "services/bus/wire.h"

namespace etude::bus {
namespace {

using security::Role;

constexpr std::string_view kAnyHost = "*";

// What follows the name of a campaign or run. The * of the library crosses "/": any host's partitions, and the one
// above.
std::string EndOf(Scope scope, std::string_view host) {
  if (scope == Scope::kEpisodes) return "/*/episode";
  if (scope == Scope::kRelay) return "/*/relay";
  const bool of_host = scope == Scope::kCampaignHost || scope == Scope::kRunHost;
  return of_host && host != kAnyHost ? "/*/" + std::string(host) : "/*";
}

// The partitions of a scope, as patterns; of what is meant for one host those of `host`, which may be any. "NAME/*" and
// never "NAME*": that would let a campaign "ab" into "a".
std::vector<std::string> PartitionsOf(Scope scope, std::string_view host, const std::vector<std::string>& campaigns,
                                      const std::vector<std::string>& runs) {
  if (scope == Scope::kDirectory) return {kDirectoryPartition};
  if (scope == Scope::kPlay) return {"play", "play/*"};
  if (scope == Scope::kDoctor) return {"doctor-*"};
  const bool of_run = scope == Scope::kRun || scope == Scope::kRelay || scope == Scope::kRunHost;
  const std::string end = EndOf(scope, host);
  const auto& names = of_run ? runs : campaigns;
  std::vector<std::string> partitions;
  if (names.empty()) return {"*" + end};
  for (const auto& name : names) partitions.push_back(name + end);
  partitions.push_back("eval-*" + end);
  if (of_run) partitions.push_back("play-*" + end);  // what `etude play open --checkpoint` serves
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

std::vector<security::Grant> GrantsFor(const std::vector<Role>& roles, const std::string& host,
                                       const std::vector<std::string>& campaigns,
                                       const std::vector<std::string>& runs) {
  RoleMask mask = 0;
  for (const Role role : roles) mask |= MaskOf(role);
  std::vector<security::Grant> grants;
  const auto grant = [&](bool publish, const TopicAccess& item, std::string_view of_host) {
    for (auto& partition : PartitionsOf(item.access.scope, of_host, campaigns, runs))
      grants.push_back({publish, item.topic, std::move(partition)});
  };
  for (const TopicAccess& item : TopicAccesses()) {
    if ((item.access.publish & mask) != 0) grant(true, item, kAnyHost);
    const RoleMask readers = item.access.subscribe & mask;
    if (readers != 0) grant(false, item, (readers & ~kOfOneHost) != 0 ? kAnyHost : std::string_view(host));
  }
  return grants;
}

}  // namespace etude::bus
