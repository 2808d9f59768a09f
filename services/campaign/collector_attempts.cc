// SPDX-License-Identifier: Apache-2.0
// What becomes of attempts at work: reports, heartbeats, and workers of whom nothing is heard any more.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "services/campaign/collector_impl.h"
#include "services/core/log.h"
#include "services/episode/bounded_json.h"
#include "services/spec/attempt_outcome.h"

namespace etude::campaign {

namespace {

// What the worker says, and when it said so. What is no JSON object stays what it is.
std::string DetailsOf(const bus::AttemptReport& report) {
  constexpr int kDeepest = 16;
  auto details = ParseBoundedJson(report.details_json, kDeepest);
  if (!details || !details->is_object()) return report.details_json;
  (*details)["t"] = std::round(WallSeconds() * 1000) / 1000;
  (*details)["worker"] = report.worker;
  return JsonText(*details);
}

}  // namespace

// By what may come after its goodbye, or from anybody.
void Collector::Impl::HearAgain(const std::string& worker) {
  if (const auto known = heard.find(worker); known != heard.end()) known->second = MonotonicClock::now();
}

void Collector::Impl::OnReport(const bus::AttemptReport& report) {
  if (report.campaign_id != id || report.spec_sha256 != spec_sha256 || report.index >= spec.episodes) return;
  // any bytes may stand there, and it becomes a key of JSON
  std::string outcome = IsPlainName(report.outcome) ? report.outcome : "unnamed";
  if (OnReportAgain(report, outcome)) return;
  {
    const MutexLock lock(mutex);
    // of others than who holds the lease nothing counts; heartbeats, which others hear, do not say the token
    if (table.Check(report.index, report.attempt, report.token) != LeaseValidity::kCurrent ||
        !table.WentTo(report.index, report.worker)) {
      ++counters.stale_results;
      return;
    }
    HearAgain(report.worker);
    if (report.outcome == kReleased) {
      if (!OnReleased(report)) return;
      outcome = kKillsWorkers;
    } else {
      ++counters.failures[outcome];
      table.Fail(report.index, RetryOf(spec, outcome));
      if (outcome == kPolicyError) {
        OnPolicyError(report);
      } else {
        ++failed_attempts;
        policy_away_since.reset();
      }
    }
  }
  Record(report.index, report.attempt, outcome, DetailsOf(report));
}

void Collector::Impl::OnHeartbeat(const bus::WorkerStatus& status) {
  if (status.campaign_id != id) return;
  const MutexLock lock(mutex);
  const Time now = MonotonicClock::now();
  if (status.phase == bus::kGonePhase) {
    heard.erase(status.worker);
    motions.erase(status.worker);
    idle.erase(status.worker);
    return;
  }
  heard[status.worker] = now;
  if (status.token == 0)
    idle.try_emplace(status.worker, now);
  else
    idle.erase(status.worker);
  const bool leased = status.token != 0 && table.WentTo(status.index, status.worker);
  if (leased) table.Renew(status.index, status.token, now);
  if (!leased && (status.token == 0 || !rechecks.Renew(status.token, status.worker, now))) {
    motions.erase(status.worker);
    return;
  }
  Motion& motion = motions[status.worker];
  if (!motion.SameAs(status)) motion = {status.index, status.token, status.phase, status.stage, status.step, now};
}

// A host whose child was lost says so: counted by name, not against the attempt, and the index yields to others; unless
// it was the attempt that ended it, and others before. True when it has failed.
bool Collector::Impl::OnReleased(const bus::AttemptReport& report) {
  const auto details = ParseBoundedJson(report.details_json, 4).value_or(OrderedJson());
  const bool said = details.is_object() && details.contains("reason") && details["reason"].is_string();
  const std::string reason = said ? details["reason"].get<std::string>() : "";
  if (reason != kChildCrashed && reason != kChildHung) {
    table.Release(report.index);
    return false;
  }
  ++counters.failures[reason];
  Log().warn("a worker lost its child worker={} index={}: {}", report.worker, report.index, JsonText(details));
  const bool by_attempt = details.contains(kByAttempt) && details[kByAttempt] == true;
  if (!by_attempt) {
    table.Fail(report.index, Retry::kSameAttempt);
    return false;
  }
  if (!table.CountDeath(report.index)) return false;
  CountKilled();
  return true;
}

// The policy's absence is no attempt at the scene. Rollouts wait for it, with words, and none is given up; after a
// while the evaluation fails, and at once where waiting does not help.
void Collector::Impl::OnPolicyError(const bus::AttemptReport& report) {
  const Time now = MonotonicClock::now();
  if (!policy_away_since) policy_away_since = now;
  const auto details = ParseBoundedJson(report.details_json, 4).value_or(OrderedJson());
  policy_error = details.is_object() && details.contains("reason") && details["reason"].is_string()
                     ? details["reason"].get<std::string>().substr(0, 1000)
                     : "no reason said";
  const bool refused = details.is_object() && details.contains(kPolicyRefused) && details[kPolicyRefused] == true;
  if (Stopping() || (!refused && now - *policy_away_since < options.policy_patience)) return;
  const std::string kept = fmt::format("{} of {} rollouts are kept", table.committed(), spec.episodes);
  if (refused)
    ended_by = Error{Code::kInvalidArgument,
                     fmt::format("roll out '{}': {}; {}: `etude checkpoint show` says what a policy is for, and `etude "
                                 "eval --scenes` takes scenes of that",
                                 spec.name, policy_error, kept)};
  else
    ended_by = Error{Code::kUnavailable,
                     fmt::format("roll out '{}': the policy of run '{}' answered nobody for {:.0f} s ({}); {}: start "
                                 "its `etude policy`, then run this again",
                                 spec.name, spec.rollout.run,
                                 std::chrono::duration<double>(now - *policy_away_since).count(), policy_error, kept)};
  stop = true;
}

// This process, or its machine, was stopped: what workers said meanwhile has not been delivered yet.
void Collector::Impl::ForgiveStandstill() {
  const Time now = MonotonicClock::now();
  const auto stood = now - std::exchange(looked, now);
  if (stood < options.lease / 2) return;
  const MutexLock lock(mutex);
  table.Postpone(stood);
  rechecks.Postpone(stood);
  for (auto& [worker, motion] : motions) motion.since += stood;
  for (auto& [worker, since] : idle) since += stood;
}

// Leases of those who say nothing, and of those who say that they live and do not move: a planner that never ends, a
// simulation that hangs, while the thread that beats goes on.
std::vector<Collector::Impl::Deadly> Collector::Impl::EndSilent() {
  constexpr std::size_t kMostRemembered = 1000;
  const MutexLock lock(mutex);
  const Time now = MonotonicClock::now();
  const std::size_t before = silent.size();
  if (const int lost = table.Expire(now, &silent)) Log().warn("leases expired without a word count={}", lost);
  rechecks.Expire(now, &silent);
  std::vector<Deadly> deadly;
  for (auto& [worker, motion] : motions)
    if (auto failed = EndIfStill(worker, motion, now)) deadly.push_back(std::move(*failed));
  // who waits for work asks five times a second; to make oneself ready may take long, and not for ever
  constexpr double kReady = 5;  // times what an attempt may stand still
  const std::chrono::duration<double> ready(
      std::max(kReady * spec.stall_timeout_s, std::chrono::duration<double>(options.ready).count()));
  for (auto& [worker, since] : idle) {
    if (all_done || now - since < ready) continue;
    Log().warn("worker={} beats and asks for nothing for {:.0f} s", worker, ready.count());
    silent.push_back(worker);
    since = now;
  }
  for (std::size_t k = before; k < silent.size(); ++k) motions.erase(silent[k]);
  if (silent.size() > kMostRemembered) silent.erase(silent.begin(), silent.end() - kMostRemembered);
  return deadly;
}

std::optional<Collector::Impl::Deadly> Collector::Impl::EndIfStill(const std::string& worker, Motion& motion,
                                                                   Time now) {
  // a rollout stands still while its policy's server starts, for a minute at most (services/policy/client.h)
  constexpr double kWaitsForPolicy_s = 75;
  const std::chrono::duration<double> patience(
      spec.mode == "rollout" ? std::max(spec.stall_timeout_s, kWaitsForPolicy_s) : spec.stall_timeout_s);
  // what is sent may wait for our own disk; what never comes through is no work either
  const bool for_our_disk = motion.phase == "send" && (!disk_errors.empty() || !committing.empty());
  if (motion.mark == 0 || for_our_disk || now - motion.since < patience) return std::nullopt;
  motion.since = now;
  const bool leased = table.Renew(motion.index, motion.mark, now);
  if (!leased && !rechecks.Renew(motion.mark, worker, now)) return std::nullopt;  // not its lease any more
  Log().warn("took a lease from a worker that does not move worker={} index={} stage='{}' step={} for {} s", worker,
             motion.index, motion.stage, motion.step, patience.count());
  ++counters.failures["stalled"];
  silent.push_back(worker);
  // what a rollout waits for is elsewhere
  return Revoke(worker, leased && spec.mode != "rollout",
                fmt::format("a worker that did not move for {} s in stage '{}'", patience.count(), motion.stage));
}

// What is returned has failed: whoever has let go of the mutex records it.
std::optional<Collector::Impl::Deadly> Collector::Impl::Revoke(const std::string& worker, bool by_attempt,
                                                               const std::string& how) {
  // an episode that is on its way, or on its way to the disk, is made: what it waits for is elsewhere
  const auto motion = motions.find(worker);
  const bool made = (motion != motions.end() && motion->second.phase == "send") ||
                    std::ranges::any_of(committing, [&](const auto& item) ETUDE_REQUIRES(mutex) {
                      return table.WentTo(item.first, worker);
                    });
  const auto failed = table.Revoke(worker, by_attempt && !made);
  rechecks.Revoke(worker);
  if (!failed) return std::nullopt;
  CountKilled();
  return Deadly{failed->index, failed->attempt, how};
}

void Collector::Impl::CountKilled() {
  ++counters.failures[kKillsWorkers];
  ++failed_attempts;
}

void Collector::Impl::Record(const Deadly& failed) {
  Log().error("attempt {} of index {} ended worker after worker and has failed; the last one: {}", failed.attempt,
              failed.index, failed.how);
  Record(failed.index, failed.attempt, kKillsWorkers,
         JsonText(OrderedJson{{"reason", failed.how}, {"t", WallSeconds()}}));
}

void Collector::Impl::Record(std::uint64_t index, std::uint32_t attempt, const std::string& outcome,
                             const std::string& details) {
  if (const Status recorded = sink->RecordFailure(index, attempt, outcome, details); !recorded)
    return Log().warn("cannot record a failed attempt index={}: {}", index, recorded.error().message);
  index_dirty = true;
}

}  // namespace etude::campaign
