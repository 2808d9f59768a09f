// SPDX-License-Identifier: Apache-2.0
// What the two clients share: finding the policy server of a run, and what is asked and replied. Internal to
// services/policy.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>

#include "services/bus/directory.h"
#include "services/bus/owner.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/core/stop.h"

namespace etude::policy {

/// With one policy server, known by the id of its run. Replies are bus::Action or bus::Insight. Not thread-safe.
template <class Reply>
struct Conversation {
  bus::Presence server;
  bus::Writer<bus::Observation> observations;
  bus::Reader<Reply> replies;

  struct Waits {
    std::chrono::nanoseconds server;   ///< for it to appear
    std::chrono::nanoseconds readers;  ///< for its readers to be found
  };
  /// Nothing when no server of `run` is there in time. @error as bus::Directory::Find; of the bus
  static Result<std::optional<Conversation>> Begin(const bus::Participant& participant, bus::Directory& directory,
                                                   const Selector& run, const Waits& waits) {
    ETUDE_ASSIGN_OR_RETURN(const auto found, directory.Find(bus::PresenceKind::kPolicy, run, waits.server));
    if (!found) return std::optional<Conversation>();
    const std::string partition = bus::Owner{found->name, found->id}.partition();
    // actions come to who asked, insights to whoever looks
    const bool addressed = std::is_same_v<Reply, bus::Action>;
    const std::string replied = addressed ? bus::PartitionOfAddress(partition, participant.address()) : partition;
    // before the observations: who is asked can then answer at once
    ETUDE_ASSIGN_OR_RETURN(auto replies, bus::Reader<Reply>::Open(participant, replied));
    ETUDE_ASSIGN_OR_RETURN(auto observations, bus::Writer<bus::Observation>::Open(participant, partition));
    // an observation that is written before the server's reader is found is lost
    observations.WaitForReaders(1, waits.readers);
    return std::optional<Conversation>(Conversation{*found, std::move(observations), std::move(replies)});
  }

  /// The first reply of this server that `is_ours`, or nothing within `timeout` or after a stop request.
  template <class IsOurs>
  std::optional<Reply> Await(std::chrono::nanoseconds timeout, IsOurs&& is_ours) {
    const auto deadline = MonotonicClock::now() + timeout;
    while (!StopRequested() && MonotonicClock::now() < deadline) {
      if (!replies.Wait(deadline - MonotonicClock::now())) break;
      for (auto& reply : replies.Take())
        if (reply.run_id == server.id && is_ours(reply)) return std::move(reply);
    }
    return std::nullopt;
  }
};

}  // namespace etude::policy
