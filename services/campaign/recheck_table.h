// SPDX-License-Identifier: Apache-2.0
// Which committed episodes are made again by a worker of another host than the one that made them, and who does so
// now. Pure as LeaseTable is: time is an argument, nothing is sent or stored.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "services/campaign/lease_table.h"
#include "services/core/clock.h"

namespace etude::campaign {

struct RecheckConfig {
  double share = 0;                                             ///< of the episodes, 0 to 1
  std::uint64_t seed = 0;                                       ///< of the campaign
  std::uint64_t epoch = 1;                                      ///< as LeaseTableConfig::epoch
  std::chrono::nanoseconds duration{std::chrono::seconds(10)};  ///< of a lease without renewal
};

/// An episode that is durable.
struct CommittedEpisode {
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  std::string worker, host;  ///< who made it
  std::string sha256;        ///< hex, of EncodeEpisode's bytes
};

/// What is made again. Each episode is leased at most kMostTries times: what nobody brings then stays unchecked. Not
/// thread-safe.
class RecheckTable {
 public:
  using Time = MonotonicClock::time_point;
  static constexpr int kMostTries = 3;
  static constexpr std::size_t kMostWaiting = 100'000;  ///< beyond it none are added
  static constexpr std::chrono::seconds kPatience{60};  ///< of Awaits, without any news

  explicit RecheckTable(const RecheckConfig& config) : config_(config) {}

  /// A function of (seed, index): the same in every life of the collector, and for each shard's episodes.
  bool Chosen(std::uint64_t index) const;
  /// Was just committed; kept when it is chosen and its host is known.
  void Add(CommittedEpisode episode, Time now);

  /// What `worker` of `host` holds (renewed), else the lowest index of those that another host made; nothing where
  /// there is none. Tokens are as unguessable as LeaseTable's.
  std::optional<Assignment> Request(const std::string& worker, const std::string& host, Time now);
  /// Whether an episode waits that a worker of `host` may make again.
  bool WaitsFor(const std::string& host) const;
  bool Holds(const std::string& worker) const { return holders_.contains(worker); }
  /// A heartbeat of `worker` that names its lease by `mark` (MarkOf); false when it holds no such lease.
  bool Renew(std::uint64_t mark, const std::string& worker, Time now);

  /// A lease that `worker` has and names, with what is to be compared.
  struct Lease {
    CommittedEpisode episode;
    std::string worker, host;
  };
  /// Ends the lease because its result came. Nothing where it is not `worker`'s, or has ended.
  std::optional<Lease> Take(std::uint64_t token, const std::string& worker, Time now);
  /// `worker` gives it back undone: another one may have it.
  bool Release(std::uint64_t token, const std::string& worker);
  /// Nobody could be heard for so long: what is out lasts so much longer.
  void Postpone(std::chrono::nanoseconds by);
  /// Ends what was not renewed in time; who held it is added to `holders`.
  void Expire(Time now, std::vector<std::string>* holders);
  /// The worker is known to be dead, or does not move.
  void Revoke(const std::string& worker);

  /// Whether it is worth waiting at the end: something is being made again, or could be by one of `hosts`. Not for
  /// ever: where none is asked for in kPatience, nobody will ask.
  bool Awaits(const std::set<std::string>& hosts, Time now) const;
  std::size_t waiting() const { return waiting_count_; }
  std::uint64_t dropped() const { return dropped_; }  ///< chosen ones for which there was no room, or nobody's tries
  std::size_t in_flight() const { return leases_.size(); }

 private:
  struct Waiting {
    CommittedEpisode episode;
    int tries = 0;
  };
  struct Out {
    Waiting what;
    std::string worker, host;
    Time deadline{};
    std::uint64_t mark = 0;  // MarkOf its token
  };
  void Return(std::map<std::uint64_t, Out>::iterator lease);

  RecheckConfig config_;
  std::map<std::string, std::map<std::uint64_t, Waiting>> waiting_;  // host that made it -> index
  std::size_t waiting_count_ = 0;
  std::uint64_t dropped_ = 0;
  std::map<std::uint64_t, Out> leases_;           // by token
  std::map<std::string, std::uint64_t> holders_;  // worker -> token
  Time moved_{};                                  // of the last news
};

}  // namespace etude::campaign
