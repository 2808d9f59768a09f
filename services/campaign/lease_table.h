// SPDX-License-Identifier: Apache-2.0
// Who works on what: leases of (index, attempt) with fencing tokens. Pure: time is an argument, nothing
// is sent or stored, so every property is testable without a bus.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "services/core/clock.h"
#include "services/spec/attempt_outcome.h"
#include "services/spec/shard.h"

namespace etude::campaign {

/// A token is an epoch, and below it so many random bits: who was not told a token does not guess it, and tokens of an
/// earlier life of the collector are smaller than all of this one's.
inline constexpr int kTokenRandomBits = 40;
/// Epochs are smaller than this.
inline constexpr std::uint64_t kEpochs = 1ull << (64 - kTokenRandomBits);
constexpr std::uint64_t EpochOf(std::uint64_t token) { return token >> kTokenRandomBits; }
constexpr std::uint64_t TokenOf(std::uint64_t epoch, std::uint64_t random) {
  return (epoch << kTokenRandomBits) | (random & ((1ull << kTokenRandomBits) - 1));
}
/// What is said of a lease where others than its host and the collector may read it (heartbeats, requests): who heard
/// it can say it again, and does not learn the token, without which nothing ends or fills a lease. 0: of no lease.
std::uint64_t MarkOf(std::uint64_t token);
/// Of the system's source.
std::uint64_t SystemRandom();

struct LeaseTableConfig {
  std::uint64_t total = 0;               ///< indices 0 .. total-1 ...
  Shard shard;                           ///< ... of which only this one's are leased
  std::uint32_t max_attempts = 10;       ///< failed attempts per index; then it is given up
  std::uint32_t max_deaths = 3;          ///< of workers by one attempt; then it has failed itself
  bool one_attempt = false;              ///< another one would be the same (rollouts): then the index is given up
  std::uint64_t max_in_flight = 16'384;  ///< leases worked on at once; as many may wait
  std::chrono::nanoseconds duration{std::chrono::seconds(10)};  ///< without renewal
  std::uint64_t epoch = 1;  ///< the first bits of every token; grows with each start of the collector
  std::function<std::uint64_t()> random = nullptr;  ///< for the other bits; none: the system's source
};

/// What a worker may do next.
struct Assignment {
  enum class Kind { kWork, kWait, kDone };
  Kind kind = Kind::kWait;
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  std::uint64_t token = 0;
};

/// Whether a result or a report counts, by the lease it names.
enum class LeaseValidity {
  kCurrent,    ///< the newest lease of its index
  kCommitted,  ///< the index is already committed
  kStale,      ///< a newer token was issued, or the lease was ended: refuse
};

/// Leases every index until it is committed or given up. Invariants: at most one token of an index is
/// current, and no two indices have the same one; attempt k+1 is leased only after attempt k failed with a current
/// token, so that which attempt is committed does not depend on who worked when. Not thread-safe.
class LeaseTable {
 public:
  using Time = MonotonicClock::time_point;

  explicit LeaseTable(const LeaseTableConfig& config);

  /// Resuming: what an earlier life of the collector left. Call before the first Request. Indices that are not the
  /// table's are passed over.
  void RestoreCommitted(std::uint64_t index);
  void RestoreFailures(std::uint64_t index, std::uint32_t failures, std::uint32_t next_attempt);

  /// Work for `worker`: the lease it already holds (renewed), else the lowest free index. With `working_on`, the mark
  /// of what it works on: the next one beside that, so that it need not wait when it is done. There is one ahead at
  /// most, none where fewer indices are left than workers work (somebody else may be free for it sooner), and none for
  /// who works on what is no lease of this table.
  Assignment Request(const std::string& worker, Time now, std::uint64_t working_on = 0);
  /// Whether a lease of `worker` is out, beside that of `working_on`.
  bool Holds(const std::string& worker, std::uint64_t working_on = 0) const;
  /// A heartbeat that names `mark`, which is worked on; the lease that waits beside it is renewed, too. One that had
  /// expired and was not leased again lives again. False when that lease is not current.
  bool Renew(std::uint64_t index, std::uint64_t mark, Time now);
  /// Nobody could be heard for so long: what is leased lasts so much longer.
  void Postpone(std::chrono::nanoseconds by);
  /// Makes leases that were not renewed in time free again; returns how many, and whose in `holders`. Their tokens stay
  /// current until the index is leased again: a late result is then still the newest there is.
  int Expire(Time now, std::vector<std::string>* holders = nullptr);

  /// The index whose newest lease has this token; nothing when it is stale.
  std::optional<std::uint64_t> IndexOf(std::uint64_t token) const;

  LeaseValidity Check(std::uint64_t index, std::uint32_t attempt, std::uint64_t token) const;
  /// Whether the newest lease of `index` went to `worker`, expired or not: a token that somebody else overheard does
  /// not make it theirs.
  bool WentTo(std::uint64_t index, const std::string& worker) const;

  /// The index is durable. Any token of it is stale from now on.
  void Commit(std::uint64_t index);
  /// A failed attempt with a current token (Check first). Frees the index with the next attempt, or gives
  /// it up when max_attempts have failed, or at once when it can never succeed. kSameAttempt: not the attempt's failure
  /// but its worker's, or the policy's; nothing is counted, and the index yields to others.
  void Fail(std::uint64_t index, Retry retry);
  /// The attempt with the current token ended who worked on it, by a crash or a hang of its own and not from outside.
  /// It is a function of (spec, index, attempt) and may do so to every worker: max_deaths times, and it has failed.
  /// @returns whether it has
  bool CountDeath(std::uint64_t index);
  /// The holder of the current token gives the work back undone: free again, nothing is counted.
  void Release(std::uint64_t index);
  struct Failed {
    std::uint64_t index = 0;
    std::uint32_t attempt = 0;
  };
  /// The worker is known to be dead: its lease ends, and counts as a loss; one that waited is free again.
  /// @param by_attempt  what it worked on ended it (CountDeath)    @returns that attempt, when it has failed
  std::optional<Failed> Revoke(const std::string& worker, bool by_attempt = false);

  /// One after the largest index that was ever leased or restored: of the ones from here on nobody knows anything.
  std::uint64_t frontier() const { return frontier_; }

  /// How many indices there are to lease.
  std::uint64_t size() const { return config_.shard.CountOf(config_.total); }
  bool complete() const { return committed_.size() + given_up_ == size(); }
  std::uint64_t committed() const { return committed_.size(); }
  std::uint64_t given_up() const { return given_up_; }
  std::uint64_t in_flight() const { return live_.size(); }  ///< leases that are out, those that wait among them
  /// Leases that ended without a word of their holder.
  std::uint64_t lost() const { return lost_; }

 private:
  struct Entry {
    std::uint32_t attempt = 0;
    std::uint32_t failures = 0;
    std::uint32_t losses = 0;  ///< leases that expired; such an index yields to others
    std::uint32_t deaths = 0;  ///< workers that this attempt ended
    std::uint64_t token = 0;   ///< newest, 0: none or ended (SetToken)
    std::uint64_t mark = 0;    ///< MarkOf(token)
    bool live = false;         ///< leased now
    bool ahead = false;        ///< and not worked on yet
    bool revoked = false;      ///< its worker may finish it, and is not leased it again by going on
    bool closed = false;       ///< committed or given up
    Time deadline{};
    std::string worker;
  };

  bool Has(std::uint64_t index) const { return index < config_.total && config_.shard.Has(index); }
  Entry& EntryOf(std::uint64_t index);
  const Entry* Find(std::uint64_t index) const;
  void Free(std::uint64_t index, Entry& entry);
  Retry AfterDeaths() const { return config_.one_attempt ? Retry::kNever : Retry::kNextAttempt; }
  void Close(std::uint64_t index, Entry& entry);
  void EndLease(std::uint64_t index, Entry& entry);
  void Begin(Entry& entry);
  void Lose(std::uint64_t index, Entry& entry);
  bool Revive(std::uint64_t index, Entry& entry);
  Assignment Lease(const std::string& worker, Time now, bool ahead);
  std::optional<std::uint64_t> NextFree();
  std::uint64_t NewToken() const;
  void SetToken(std::uint64_t index, Entry& entry, std::uint64_t token);

  LeaseTableConfig config_;
  std::uint64_t frontier_ = 0;
  std::uint64_t next_fresh_;                                ///< indices from here on were never leased or restored ...
  std::unordered_map<std::uint64_t, Entry> entries_;        ///< ... unless they are in here
  std::set<std::pair<std::uint32_t, std::uint64_t>> free_;  ///< (losses, index) given back
  std::set<std::uint64_t> live_;
  std::uint64_t ahead_ = 0;                                 ///< of live_: those not worked on yet
  std::map<std::string, std::vector<std::uint64_t>> held_;  ///< worker -> indices, one or two, in the order of leasing
  std::unordered_map<std::uint64_t, std::uint64_t> index_;  ///< newest tokens -> index
  std::unordered_set<std::uint64_t> committed_;             ///< closed as committed
  std::uint64_t given_up_ = 0, lost_ = 0;
};

}  // namespace etude::campaign
