// SPDX-License-Identifier: Apache-2.0
// Which of the collectors that share a campaign a worker asks next, and when it leaves the one that it asks. Apart from
// the bus, so that it can be tested.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <set>
#include <string>

namespace etude::campaign {

/// Of one worker. Episodes depend on none of it. Shards are known by their number (Presence::shard).
class ShardChoice {
 public:
  /// How long a shard may have nothing to lease before the worker looks elsewhere: at first, and at most.
  static constexpr double kLeastPatience_s = 2, kMostPatience_s = 60;

  /// @param worker  its name: others begin elsewhere  @param stay  at a shard that has work, about
  ShardChoice(std::string worker, std::chrono::milliseconds stay);

  /// Of `open`, those that are there and not complete: the next one behind the last that was joined, or, where none
  /// was, any of them. None: `open` is empty.
  std::optional<std::uint32_t> Next(const std::set<std::uint32_t>& open) const;
  void Joined(std::uint32_t shard);
  /// Chance says which is next.
  void GoAnywhere() { last_.reset(); }

  /// Whether a shard that had nothing to lease for so long is left for another one.
  bool IsImpatient(double idle_s) const { return idle_s >= patience_s_; }
  /// The other one may have nothing, too: less and less often.
  void WaitLonger();
  void FoundWork() { patience_s_ = kLeastPatience_s; }
  /// Whether it was at this one for so long that it is another one's turn: half to one and a half of `stay`.
  bool HasStayed(double joined_s) const;

 private:
  double Draw() const;

  std::string worker_;
  double stay_s_;
  std::optional<std::uint32_t> last_;  // that was joined
  std::uint64_t joins_ = 0;
  double patience_s_ = kLeastPatience_s;
};

}  // namespace etude::campaign
