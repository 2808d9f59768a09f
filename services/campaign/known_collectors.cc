// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/known_collectors.h"

#include <algorithm>
#include <utility>

#include "services/core/log.h"

namespace etude::campaign {

using namespace std::chrono_literals;

void KnownCollector::TakeAnnouncements() {
  for (auto& taken : announcements.Take())
    if (taken.campaign_id == presence.id && (!announcement || taken.epoch >= announcement->epoch))
      announcement = std::move(taken);
}

bool KnownCollector::complete() const {
  return announcement && (announcement->complete || done_in == std::optional(announcement->epoch));
}

KnownCollectors::KnownCollectors(const bus::Participant& participant, const Selector& selector,
                                 bus::Directory directory)
    : participant_(&participant), selector_(selector), directory_(std::move(directory)) {}

Result<KnownCollectors> KnownCollectors::Open(const bus::Participant& participant, const Selector& selector) {
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  return KnownCollectors(participant, selector, std::move(directory));
}

bool KnownCollectors::IsOfTheCampaign(const bus::Presence& presence) const {
  if (empty()) return false;
  return presence.id == known().id || bus::AreShardsOfOneCampaign(presence, known());
}

bool KnownCollectors::IsKnown(const bus::Presence& presence) const {
  const auto known = by_shard_.find(presence.shard);
  return known != by_shard_.end() && known->second->presence.id == presence.id;
}

bool KnownCollectors::Knows(const KnownCollector& collector) const { return IsKnown(collector.presence); }

// Those that are there.
std::vector<bus::Presence> KnownCollectors::Live() {
  auto live = directory_.Matching(bus::PresenceKind::kCampaign, selector_);
  std::erase_if(live, [&](const bus::Presence& presence) { return !IsOfTheCampaign(presence); });
  return live;
}

Result<bool> KnownCollectors::LookAround() {
  bool another = false;
  if (Live().empty()) {
    ETUDE_ASSIGN_OR_RETURN(const auto found, directory_.FindCampaign(selector_, 1s));
    if (found.empty()) return false;
    another = !empty() && !IsOfTheCampaign(found.front());
    if (another && !directory_.Replaced(bus::PresenceKind::kCampaign, selector_, known().id, known().user))
      return false;
    if (another) Forget();
    for (const auto& presence : found) ETUDE_RETURN_IF_ERROR(Know(presence));
  }
  ETUDE_RETURN_IF_ERROR(Learn());
  return another;
}

void KnownCollectors::Forget() {
  Log().info("campaign={}@{} has gone, another one of its name is there", selector_.name, known().id);
  by_shard_.clear();
}

Status KnownCollectors::Learn() {
  for (const auto& presence : Live()) ETUDE_RETURN_IF_ERROR(Know(presence));
  for (auto& [shard, collector] : by_shard_) collector->TakeAnnouncements();
  return {};
}

Status KnownCollectors::Know(const bus::Presence& presence) {
  if (IsKnown(presence)) return {};
  const std::string partition = bus::Owner{presence.name, presence.id}.partition();
  ETUDE_ASSIGN_OR_RETURN(auto announcements, bus::Reader<bus::CampaignAnnouncement>::Open(*participant_, partition));
  by_shard_[presence.shard] = std::shared_ptr<KnownCollector>(
      new KnownCollector{.presence = presence, .announcements = std::move(announcements)});
  return {};
}

std::set<std::uint32_t> KnownCollectors::OpenShards() {
  std::set<std::uint32_t> open;
  for (const auto& presence : Live())
    if (IsKnown(presence) && !At(presence.shard)->complete()) open.insert(presence.shard);
  return open;
}

bool KnownCollectors::Complete() const {
  return !empty() && std::ranges::all_of(by_shard_, [](const auto& item) { return item.second->complete(); });
}

bool KnownCollectors::Replaced(const std::string& id) {
  if (!directory_.Replaced(bus::PresenceKind::kCampaign, selector_, id, empty() ? "" : known().user)) return false;
  const auto live = Live();
  return live.empty() || std::ranges::any_of(live, [&](const bus::Presence& presence) {
           return !IsKnown(presence) || !At(presence.shard)->complete();
         });
}

bool KnownCollectors::HasGone(const std::string& id) {
  return directory_.Matching(bus::PresenceKind::kCampaign, {selector_.name, id}).empty();
}

}  // namespace etude::campaign
