// SPDX-License-Identifier: Apache-2.0
// The collectors of the campaign that a worker is for, as far as they were ever seen. Internal to services/campaign.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "services/bus/directory.h"
#include "services/bus/participant.h"
#include "services/bus/topic.h"

namespace etude::campaign {

/// A campaign's only collector, or that of a shard. What it says is heard also while the worker is at another one, and
/// after its end.
struct KnownCollector {
  bus::Presence presence;
  bus::Reader<bus::CampaignAnnouncement> announcements;
  std::optional<bus::CampaignAnnouncement> announcement = std::nullopt;  ///< the newest
  std::optional<std::uint64_t> done_in = std::nullopt;  ///< epoch in which it told this worker that all is done

  void TakeAnnouncements();
  /// As far as it has said.
  bool complete() const;
};

/// One thread at a time.
class KnownCollectors {
 public:
  /// Of the campaign that `selector` means; with a name alone, the same user's next one of that name once it has gone.
  /// `participant` must outlive it. @error of the bus
  static Result<KnownCollectors> Open(const bus::Participant& participant, const Selector& selector);

  const Selector& selector() const { return selector_; }
  bool empty() const { return by_shard_.empty(); }
  /// Waits up to a second for the campaign while nobody of it is there, and learns of those that are.
  /// @returns whether another campaign of the name has taken the place of the one that was known
  /// @error kInvalidArgument: several are meant; kUnavailable: another wire number; of the bus
  Result<bool> LookAround();
  /// Shards may begin later than others, and end while the worker is elsewhere. One that goes on in another folder is
  /// another collector, in the place of the one that was known. @error of the bus
  Status Learn();
  /// Whether it is one of them still.
  bool Knows(const KnownCollector& collector) const;
  /// Shards that are there and, as far as they have said, not complete.
  std::set<std::uint32_t> OpenShards();
  /// @pre it is one of OpenShards
  std::shared_ptr<KnownCollector> At(std::uint32_t shard) const { return by_shard_.at(shard); }
  /// All that were ever seen are complete. False: none was.
  bool Complete() const;
  /// True when the collector `id` is not there and that of another shard with work is, or of another campaign of the
  /// name and the same user.
  bool Replaced(const std::string& id);
  bool HasGone(const std::string& id);

 private:
  KnownCollectors(const bus::Participant& participant, const Selector& selector, bus::Directory directory);
  bool IsOfTheCampaign(const bus::Presence& presence) const;
  bool IsKnown(const bus::Presence& presence) const;
  std::vector<bus::Presence> Live();
  Status Know(const bus::Presence& presence);
  const bus::Presence& known() const { return by_shard_.begin()->second->presence; }  // one of them, @pre !empty()
  void Forget();

  const bus::Participant* participant_;
  Selector selector_;
  bus::Directory directory_;
  std::map<std::uint32_t, std::shared_ptr<KnownCollector>> by_shard_;
};

}  // namespace etude::campaign
