// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/lease_table.h"

#include <algorithm>

#include "services/core/check.h"

namespace etude::campaign {

LeaseTable::LeaseTable(const LeaseTableConfig& config) : config_(config) {
  ETUDE_CHECK(config.total >= 1 && config.max_attempts >= 1 && config.max_in_flight >= 1);
  ETUDE_CHECK(config.epoch >= 1 && config.epoch < (1ull << 32), "epoch={}", config.epoch);
}

LeaseTable::Entry& LeaseTable::EntryOf(std::uint64_t index) {
  ETUDE_CHECK(index < config_.total, "index={} total={}", index, config_.total);
  frontier_ = std::max(frontier_, index + 1);
  return entries_[index];
}

const LeaseTable::Entry* LeaseTable::Find(std::uint64_t index) const {
  const auto it = entries_.find(index);
  return it == entries_.end() ? nullptr : &it->second;
}

void LeaseTable::RestoreCommitted(std::uint64_t index) {
  if (index >= config_.total) return;  // the campaign was made shorter
  Commit(index);
}

void LeaseTable::RestoreFailures(std::uint64_t index, std::uint32_t failures, std::uint32_t next_attempt) {
  if (index >= config_.total) return;
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
  entry.live = false;
  live_.erase(index);
  const auto it = holder_.find(entry.worker);
  if (it != holder_.end() && it->second == index) holder_.erase(it);
}

void LeaseTable::Free(std::uint64_t index, Entry& entry) {
  EndLease(index, entry);
  free_.emplace(entry.losses, index);
}

void LeaseTable::Close(std::uint64_t index, Entry& entry) {
  EndLease(index, entry);
  free_.erase({entry.losses, index});
  entry.closed = true;
  entry.token = 0;
}

std::optional<std::uint64_t> LeaseTable::NextFree() {
  while (next_fresh_ < config_.total && entries_.contains(next_fresh_)) ++next_fresh_;
  const bool fresh = next_fresh_ < config_.total;
  if (free_.empty()) return fresh ? std::optional(next_fresh_) : std::nullopt;
  // an index that keeps losing its workers goes behind those that were never tried
  if (fresh && std::pair(0u, next_fresh_) < *free_.begin()) return next_fresh_;
  return free_.begin()->second;
}

Assignment LeaseTable::Request(const std::string& worker, Time now) {
  if (complete()) return {Assignment::Kind::kDone};
  if (const auto held = holder_.find(worker); held != holder_.end()) {
    Entry& entry = EntryOf(held->second);
    entry.deadline = now + config_.duration;
    return {Assignment::Kind::kWork, held->second, entry.attempt, entry.token};
  }
  if (live_.size() >= config_.max_in_flight) return {Assignment::Kind::kWait};
  const auto index = NextFree();
  if (!index) return {Assignment::Kind::kWait};

  Entry& entry = EntryOf(*index);
  free_.erase({entry.losses, *index});
  entry.token = (config_.epoch << 32) | ++counter_;
  entry.live = true;
  entry.deadline = now + config_.duration;
  entry.worker = worker;
  live_.insert(*index);
  holder_[worker] = *index;
  return {Assignment::Kind::kWork, *index, entry.attempt, entry.token};
}

bool LeaseTable::Renew(std::uint64_t index, std::uint64_t token, Time now) {
  const auto it = entries_.find(index);
  if (it == entries_.end() || !it->second.live || it->second.token != token) return false;
  it->second.deadline = now + config_.duration;
  return true;
}

int LeaseTable::Expire(Time now, std::vector<std::string>* holders) {
  std::vector<std::uint64_t> expired;
  for (const std::uint64_t index : live_)
    if (EntryOf(index).deadline <= now) expired.push_back(index);
  for (const std::uint64_t index : expired) {
    Entry& entry = EntryOf(index);
    ++entry.losses;
    ++lost_;
    if (holders) holders->push_back(entry.worker);
    Free(index, entry);
  }
  return static_cast<int>(expired.size());
}

std::optional<std::uint64_t> LeaseTable::IndexOf(std::uint64_t token) const {
  // those that expired keep their token, too; a search through all is rare
  for (const auto& [index, entry] : entries_)
    if (token != 0 && entry.token == token && !entry.closed) return index;
  return std::nullopt;
}

LeaseValidity LeaseTable::Check(std::uint64_t index, std::uint32_t attempt, std::uint64_t token) const {
  if (committed_.contains(index)) return LeaseValidity::kCommitted;
  const Entry* entry = Find(index);
  if (!entry || entry->closed || token == 0 || entry->token != token || entry->attempt != attempt)
    return LeaseValidity::kStale;
  return LeaseValidity::kCurrent;
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
  entry.token = 0;
  if (retry == Retry::kSameAttempt) {
    ++entry.losses;
    return Free(index, entry);
  }
  ++entry.failures;
  if (retry == Retry::kNextAttempt) ++entry.attempt;
  if (entry.failures >= config_.max_attempts || retry == Retry::kNever) {
    Close(index, entry);
    ++given_up_;
  } else {
    Free(index, entry);
  }
}

void LeaseTable::Release(std::uint64_t index) {
  Entry& entry = EntryOf(index);
  if (entry.closed || entry.token == 0) return;
  entry.token = 0;
  free_.erase({entry.losses, index});
  Free(index, entry);
}

void LeaseTable::Revoke(const std::string& worker) {
  const auto held = holder_.find(worker);
  if (held == holder_.end()) return;
  const std::uint64_t index = held->second;
  Entry& entry = EntryOf(index);
  ++entry.losses;
  ++lost_;
  Free(index, entry);
}

}  // namespace etude::campaign
