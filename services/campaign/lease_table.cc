// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/lease_table.h"

#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "services/core/check.h"
#include "services/core/hash.h"

namespace etude::campaign {

std::uint64_t SystemRandom() {
  std::uint64_t bits = 0;
  ETUDE_CHECK(::getentropy(&bits, sizeof bits) == 0, "the system has no random bytes");
  return bits;
}

// SHA-256 of a text so long that to try all tokens of an epoch takes longer than any lease lasts, and that of one a few
// microseconds.
std::uint64_t MarkOf(std::uint64_t token) {
  if (token == 0) return 0;
  std::array<std::uint64_t, 2048> text{};
  text.fill(token);
  const Sha256Digest digest = Sha256Of({reinterpret_cast<const std::uint8_t*>(text.data()), sizeof text});
  std::uint64_t mark = 0;
  std::memcpy(&mark, digest.data(), sizeof mark);
  return mark == 0 ? 1 : mark;
}

LeaseTable::LeaseTable(const LeaseTableConfig& config) : config_(config), next_fresh_(config.shard.number - 1) {
  ETUDE_CHECK(config.total >= 1 && config.max_attempts >= 1 && config.max_in_flight >= 1);
  ETUDE_CHECK(config.epoch >= 1 && config.epoch < kEpochs, "epoch={}", config.epoch);
  if (!config_.random) config_.random = SystemRandom;
}

LeaseTable::Entry& LeaseTable::EntryOf(std::uint64_t index) {
  ETUDE_CHECK(Has(index), "index={} total={} shard={}", index, config_.total, config_.shard.text());
  frontier_ = std::max(frontier_, index + 1);
  return entries_[index];
}

const LeaseTable::Entry* LeaseTable::Find(std::uint64_t index) const {
  const auto it = entries_.find(index);
  return it == entries_.end() ? nullptr : &it->second;
}

void LeaseTable::RestoreCommitted(std::uint64_t index) {
  if (!Has(index)) {  // the campaign was made shorter: it is made all the same
    if (config_.shard.Has(index)) frontier_ = std::max(frontier_, index + 1);
    return;
  }
  Commit(index);
}

void LeaseTable::RestoreFailures(std::uint64_t index, std::uint32_t failures, std::uint32_t next_attempt) {
  if (!Has(index)) {  // as in RestoreCommitted: it was tried with the weights that held then
    if (config_.shard.Has(index)) frontier_ = std::max(frontier_, index + 1);
    return;
  }
  Entry& entry = EntryOf(index);
  if (entry.closed) return;
  entry.failures = failures;
  entry.attempt = next_attempt;
  if (failures >= config_.max_attempts) {
    Close(index, entry);
    ++given_up_;
  } else {
    Free(index, entry);
  }
}

void LeaseTable::EndLease(std::uint64_t index, Entry& entry) {
  if (!entry.live) return;
  Begin(entry);
  entry.live = false;
  live_.erase(index);
  const auto it = held_.find(entry.worker);
  if (it == held_.end()) return;
  std::erase(it->second, index);
  if (it->second.empty()) held_.erase(it);
}

// It is worked on, or not leased any more.
void LeaseTable::Begin(Entry& entry) {
  if (entry.ahead) --ahead_;
  entry.ahead = false;
}

// Its worker is gone. What nobody had begun yet has not cost anybody.
void LeaseTable::Lose(std::uint64_t index, Entry& entry) {
  if (!entry.ahead) {
    ++entry.losses;
    ++lost_;
  }
  Free(index, entry);
}

void LeaseTable::Free(std::uint64_t index, Entry& entry) {
  EndLease(index, entry);
  free_.emplace(entry.losses, index);
}

void LeaseTable::Close(std::uint64_t index, Entry& entry) {
  EndLease(index, entry);
  free_.erase({entry.losses, index});
  entry.closed = true;
  SetToken(index, entry, 0);
}

// One that no index has now.
std::uint64_t LeaseTable::NewToken() const {
  std::uint64_t token = 0;
  do {
    token = TokenOf(config_.epoch, config_.random());
  } while (index_.contains(token));
  return token;
}

void LeaseTable::SetToken(std::uint64_t index, Entry& entry, std::uint64_t token) {
  index_.erase(entry.token);
  entry.token = token;
  entry.mark = MarkOf(token);
  if (token != 0) index_[token] = index;
}

std::optional<std::uint64_t> LeaseTable::NextFree() {
  while (next_fresh_ < config_.total && entries_.contains(next_fresh_)) next_fresh_ += config_.shard.count;
  const bool fresh = next_fresh_ < config_.total;
  if (free_.empty()) return fresh ? std::optional(next_fresh_) : std::nullopt;
  // an index that keeps losing its workers goes behind those that were never tried
  if (fresh && std::pair(0u, next_fresh_) < *free_.begin()) return next_fresh_;
  return free_.begin()->second;
}

bool LeaseTable::Holds(const std::string& worker, std::uint64_t working_on) const {
  const auto held = held_.find(worker);
  return held != held_.end() &&
         std::ranges::any_of(held->second, [&](std::uint64_t index) { return Find(index)->mark != working_on; });
}

Assignment LeaseTable::Request(const std::string& worker, Time now, std::uint64_t working_on) {
  if (complete()) return {Assignment::Kind::kDone};
  const auto held = held_.find(worker);
  const bool works = held != held_.end() && !held->second.empty();
  if (works) {
    for (const std::uint64_t index : held->second) {
      Entry& entry = EntryOf(index);
      if (entry.mark == working_on) continue;
      if (working_on == 0) Begin(entry);
      entry.deadline = now + config_.duration;
      return {Assignment::Kind::kWork, index, entry.attempt, entry.token};
    }
  }
  // what it works on is no lease of this table (any more): no heartbeat would renew one that waits behind it
  if (working_on != 0 && !works) return {Assignment::Kind::kWait};
  return Lease(worker, now, works);
}

// One that nobody has.
Assignment LeaseTable::Lease(const std::string& worker, Time now, bool ahead) {
  const std::uint64_t working = live_.size() - ahead_;
  const std::uint64_t left = size() - committed_.size() - given_up_ - live_.size();
  if (ahead ? ahead_ >= config_.max_in_flight || left < working : working >= config_.max_in_flight)
    return {Assignment::Kind::kWait};
  const auto index = NextFree();
  if (!index) return {Assignment::Kind::kWait};

  Entry& entry = EntryOf(*index);
  free_.erase({entry.losses, *index});
  SetToken(*index, entry, NewToken());
  entry.live = true;
  entry.revoked = false;
  entry.ahead = ahead;
  ahead_ += ahead;
  entry.deadline = now + config_.duration;
  entry.worker = worker;
  live_.insert(*index);
  held_[worker].push_back(*index);
  return {Assignment::Kind::kWork, *index, entry.attempt, entry.token};
}

// One that expired, and that nobody else was leased since, is its worker's again: it was cut off, and works on.
bool LeaseTable::Renew(std::uint64_t index, std::uint64_t mark, Time now) {
  const auto it = entries_.find(index);
  if (it == entries_.end() || mark == 0 || it->second.mark != mark) return false;
  if (!it->second.live && !Revive(index, it->second)) return false;
  Begin(it->second);
  const auto held = held_.find(it->second.worker);
  if (held == held_.end()) return true;
  for (const std::uint64_t waits : held->second) EntryOf(waits).deadline = now + config_.duration;
  return true;
}

bool LeaseTable::Revive(std::uint64_t index, Entry& entry) {
  constexpr std::size_t kMostHeld = 2;
  auto& held = held_[entry.worker];
  const bool may = !entry.closed && !entry.revoked && held.size() < kMostHeld;
  if (may) {
    free_.erase({entry.losses, index});
    entry.live = true;
    live_.insert(index);
    held.push_back(index);
  } else if (held.empty()) {
    held_.erase(entry.worker);
  }
  return may;
}

void LeaseTable::Postpone(std::chrono::nanoseconds by) {
  for (const std::uint64_t index : live_) EntryOf(index).deadline += by;
}

int LeaseTable::Expire(Time now, std::vector<std::string>* holders) {
  std::vector<std::uint64_t> expired;
  for (const std::uint64_t index : live_)
    if (EntryOf(index).deadline <= now) expired.push_back(index);
  int lost = 0;
  for (const std::uint64_t index : expired) {
    Entry& entry = EntryOf(index);
    lost += entry.ahead ? 0 : 1;
    if (holders && !entry.ahead) holders->push_back(entry.worker);
    Lose(index, entry);
  }
  return lost;
}

std::optional<std::uint64_t> LeaseTable::IndexOf(std::uint64_t token) const {
  const auto found = index_.find(token);  // those that expired keep their token, too
  return found == index_.end() ? std::nullopt : std::optional(found->second);
}

LeaseValidity LeaseTable::Check(std::uint64_t index, std::uint32_t attempt, std::uint64_t token) const {
  if (committed_.contains(index)) return LeaseValidity::kCommitted;
  const Entry* entry = Find(index);
  if (!entry || entry->closed || token == 0 || entry->token != token || entry->attempt != attempt)
    return LeaseValidity::kStale;
  return LeaseValidity::kCurrent;
}

bool LeaseTable::WentTo(std::uint64_t index, const std::string& worker) const {
  const Entry* entry = Find(index);
  return entry && entry->token != 0 && entry->worker == worker;
}

void LeaseTable::Commit(std::uint64_t index) {
  Entry& entry = EntryOf(index);
  if (entry.closed) return;
  Close(index, entry);
  committed_.insert(index);
}

void LeaseTable::Fail(std::uint64_t index, Retry retry) {
  Entry& entry = EntryOf(index);
  ETUDE_CHECK(!entry.closed && entry.token != 0, "index={}: no current lease", index);
  free_.erase({entry.losses, index});  // it may have expired, and still be the newest
  SetToken(index, entry, 0);
  if (retry == Retry::kSameAttempt) {
    ++entry.losses;
    return Free(index, entry);
  }
  ++entry.failures;
  if (retry == Retry::kNextAttempt) {  // which nobody has had yet
    ++entry.attempt;
    entry.deaths = 0;
  }
  if (entry.failures >= config_.max_attempts || retry == Retry::kNever) {
    Close(index, entry);
    ++given_up_;
  } else {
    Free(index, entry);
  }
}

// One after the other of those that end workers: where only such are left, each comes to its end before whoever starts
// workers loses hope.
bool LeaseTable::CountDeath(std::uint64_t index) {
  Entry& entry = EntryOf(index);
  if (!entry.revoked) ++entry.deaths;  // else it was counted when its lease was taken
  const bool failed = entry.deaths >= config_.max_deaths;
  if (!failed) {
    free_.erase({entry.losses, index});
    entry.losses = 0;
  }
  Fail(index, failed ? AfterDeaths() : Retry::kSameAttempt);
  return failed;
}

void LeaseTable::Release(std::uint64_t index) {
  Entry& entry = EntryOf(index);
  if (entry.closed || entry.token == 0) return;
  SetToken(index, entry, 0);
  free_.erase({entry.losses, index});
  Free(index, entry);
}

std::optional<LeaseTable::Failed> LeaseTable::Revoke(const std::string& worker, bool by_attempt) {
  const auto held = held_.find(worker);
  if (held == held_.end()) return std::nullopt;
  std::optional<Failed> failed;
  const std::vector<std::uint64_t> indices = held->second;  // those below take themselves out
  for (const std::uint64_t index : indices) {
    Entry& entry = EntryOf(index);
    if (by_attempt && !entry.ahead) {
      entry.losses = 0;  // as in CountDeath
      if (++entry.deaths >= config_.max_deaths) {
        ++lost_;
        failed = {index, entry.attempt};
        Fail(index, AfterDeaths());
        continue;
      }
    }
    entry.revoked = true;
    Lose(index, entry);
  }
  return failed;
}

}  // namespace etude::campaign
