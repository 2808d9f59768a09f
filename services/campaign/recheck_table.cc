// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/recheck_table.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "services/core/rng.h"

namespace etude::campaign {

bool RecheckTable::Chosen(std::uint64_t index) const {
  return config_.share > 0 && Rng(MixSeed({config_.seed, index}, "recheck")).Uniform() < config_.share;
}

void RecheckTable::Add(CommittedEpisode episode, Time now) {
  if (episode.host.empty() || !Chosen(episode.index)) return;
  moved_ = now;
  if (waiting_count_ >= kMostWaiting) {
    ++dropped_;
    return;
  }
  auto& of_host = waiting_[episode.host];
  const std::uint64_t index = episode.index;
  if (of_host.try_emplace(index, Waiting{std::move(episode)}).second) ++waiting_count_;
}

std::optional<Assignment> RecheckTable::Request(const std::string& worker, const std::string& host, Time now) {
  const auto as_assignment = [](std::uint64_t token, const CommittedEpisode& episode) {
    return Assignment{Assignment::Kind::kWork, episode.index, episode.attempt, token};
  };
  if (const auto held = holders_.find(worker); held != holders_.end()) {
    Out& out = leases_.at(held->second);
    out.deadline = now + config_.duration;
    return as_assignment(held->second, out.what.episode);
  }
  if (host.empty()) return std::nullopt;
  auto lowest = waiting_.end();
  for (auto it = waiting_.begin(); it != waiting_.end(); ++it)
    if (it->first != host && (lowest == waiting_.end() || it->second.begin()->first < lowest->second.begin()->first))
      lowest = it;
  if (lowest == waiting_.end()) return std::nullopt;
  auto node = lowest->second.extract(lowest->second.begin());
  if (lowest->second.empty()) waiting_.erase(lowest);
  --waiting_count_;
  moved_ = now;
  Waiting& what = node.mapped();
  ++what.tries;
  std::uint64_t token = 0;
  do {
    token = TokenOf(config_.epoch, SystemRandom());
  } while (leases_.contains(token));
  const Assignment assignment = as_assignment(token, what.episode);
  leases_.insert_or_assign(token, Out{std::move(what), worker, host, now + config_.duration, MarkOf(token)});
  holders_[worker] = token;
  return assignment;
}

bool RecheckTable::WaitsFor(const std::string& host) const {
  return !host.empty() && std::ranges::any_of(waiting_, [&](const auto& item) { return item.first != host; });
}

bool RecheckTable::Renew(std::uint64_t mark, const std::string& worker, Time now) {
  const auto held = holders_.find(worker);
  if (held == holders_.end()) return false;
  Out& out = leases_.at(held->second);
  if (out.mark != mark) return false;
  out.deadline = now + config_.duration;
  return true;
}

std::optional<RecheckTable::Lease> RecheckTable::Take(std::uint64_t token, const std::string& worker, Time now) {
  const auto lease = leases_.find(token);
  if (lease == leases_.end() || lease->second.worker != worker) return std::nullopt;
  Lease taken{std::move(lease->second.what.episode), std::move(lease->second.worker), std::move(lease->second.host)};
  holders_.erase(worker);
  leases_.erase(lease);
  moved_ = now;
  return taken;
}

bool RecheckTable::Release(std::uint64_t token, const std::string& worker) {
  const auto lease = leases_.find(token);
  if (lease == leases_.end() || lease->second.worker != worker) return false;
  Return(lease);
  return true;
}

void RecheckTable::Postpone(std::chrono::nanoseconds by) {
  for (auto& [token, lease] : leases_) lease.deadline += by;
}

void RecheckTable::Expire(Time now, std::vector<std::string>* holders) {
  for (auto lease = leases_.begin(); lease != leases_.end();) {
    const auto next = std::next(lease);
    if (lease->second.deadline <= now) {
      if (holders) holders->push_back(lease->second.worker);
      Return(lease);
    }
    lease = next;
  }
}

void RecheckTable::Revoke(const std::string& worker) {
  const auto held = holders_.find(worker);
  if (held != holders_.end()) Return(leases_.find(held->second));
}

void RecheckTable::Return(std::map<std::uint64_t, Out>::iterator lease) {
  Waiting what = std::move(lease->second.what);
  holders_.erase(lease->second.worker);
  leases_.erase(lease);
  if (what.tries >= kMostTries) {
    ++dropped_;
    return;
  }
  const std::uint64_t index = what.episode.index;
  auto& of_host = waiting_[what.episode.host];
  of_host.insert_or_assign(index, std::move(what));
  ++waiting_count_;
}

bool RecheckTable::Awaits(const std::set<std::string>& hosts, Time now) const {
  if (!leases_.empty()) return true;
  if (now - moved_ >= kPatience) return false;
  return std::ranges::any_of(waiting_,
                             [&](const auto& item) { return hosts.size() > (hosts.contains(item.first) ? 1u : 0u); });
}

}  // namespace etude::campaign
