// SPDX-License-Identifier: Apache-2.0
// Who is on the domain: campaigns, runs, policy servers and relays, by name and id.
//
//   ETUDE_ASSIGN_OR_RETURN(auto directory, Directory::Open(participant));
//   ETUDE_ASSIGN_OR_RETURN(auto found, directory.Find(PresenceKind::kRun, {"quickstart", ""}, 10s));
//   Reader<TrainStatus>::Open(participant, Owner{found->name, found->id}.partition());
//
// A name that means two things is never guessed at: the error lists them.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "services/bus/messages.h"
#include "services/bus/owner.h"
#include "services/bus/participant.h"
#include "services/core/identity.h"
#include "services/core/result.h"

namespace etude::bus {

/// "campaign", "run", "policy server", "relay".
std::string ToString(PresenceKind kind);

/// Lines "  NAME@ID  host HOST  user USER  FOLDER  since 2026-01-31 12:00:00".
std::string ListText(const std::vector<Presence>& presences);

/// "shard 1/2" of a campaign that several collectors share, "" where one has all of it.
std::string ShardText(const Presence& presence);

/// Whether they are of one campaign that several collectors share; also where both are of the same shard.
bool AreShardsOfOneCampaign(const Presence& a, const Presence& b);

/// What this process says of itself: host, user, program version and time are filled in.
Presence MakePresence(PresenceKind kind, const std::string& name, const std::string& id, const std::string& folder);

/// Reads the directory. One thread at a time.
class Directory {
 public:
  static Result<Directory> Open(const Participant& participant);
  Directory(Directory&&) noexcept;
  Directory& operator=(Directory&&) noexcept;
  ~Directory();

  /// All that are there now, oldest first. Of a process that was killed its presence stays for DDS's lease (10 s).
  std::vector<Presence> Live();
  /// Those of a kind that `selector` fits, one for each id, or shard of a campaign: that with the largest epoch.
  std::vector<Presence> Matching(PresenceKind kind, const Selector& selector);
  /// True when none of those is `id`, but another one of `user` is there: a name may be another user's, too, and what
  /// followed one user's does not go on with another's (that is logged, once for each). "": whoever's.
  bool Replaced(PresenceKind kind, const Selector& selector, const std::string& id, const std::string& user);

  /// Waits (or for a stop request) until those who were there first are known: 0.3 s after opening; under security 0.3
  /// s after all that are seen have been authenticated, 3.3 s at most. Then that nobody fits means something.
  void WaitForOthers();

  /// Waits up to `timeout` (and for a stop request) for one that fits, and where there is one, as WaitForOthers does;
  /// nothing when there is none.
  /// @error kInvalidArgument: `selector` means several (the message lists them);
  /// kUnavailable: it speaks another wire number.
  Result<std::optional<Presence>> Find(PresenceKind kind, const Selector& selector, std::chrono::nanoseconds timeout);
  /// Where a run's checkpoints come from: the run itself, or where it is not there, a relay of it. @error as Find
  Result<std::optional<Presence>> FindPublisher(const Selector& selector, std::chrono::nanoseconds timeout);

  /// The collectors of the campaign that `selector` means, waited for as Find does: one, or those of its shards that
  /// are there, by their number. None: nobody is. @error as Find
  Result<std::vector<Presence>> FindCampaign(const Selector& selector, std::chrono::nanoseconds timeout);

  /// Others that are at work under this kind and id, or as a shard with the same episodes. A presence of the same host
  /// and folder is none: whoever holds the folder's lock knows that it is this start's own past.
  std::vector<Presence> Others(const Presence& own);

 private:
  struct Impl;
  explicit Directory(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Is in the directory for as long as it lives. One thread at a time.
class Announcement {
 public:
  /// Looks around first. With kAdopt its epoch becomes larger than that of any other of its id, or shard, which then
  /// gives way. @error kUnavailable: the id, or the shard, is live elsewhere (and `claim` is not kAdopt); says where
  /// and what to do.
  static Result<Announcement> Open(const Participant& participant, Presence presence, Claim claim);
  Announcement(Announcement&&) noexcept;
  Announcement& operator=(Announcement&&) noexcept;
  ~Announcement();

  const Presence& presence() const;
  /// Another one of this id, or shard, with the better right: a larger epoch, or the same one and an earlier start.
  /// Then this one must end; both were started before they could see each other, or the other one adopted the id.
  std::optional<Presence> Successor();

 private:
  struct Impl;
  explicit Announcement(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// What to say when Successor() returned one.
Error GivingWay(const Presence& own, const Presence& successor);

}  // namespace etude::bus
