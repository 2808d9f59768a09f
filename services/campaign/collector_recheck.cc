// SPDX-License-Identifier: Apache-2.0
// A share of the committed episodes is made again on another host and compared byte for byte. Nothing is ever
// overwritten: a difference is counted, logged and recorded with both hosts' names, for people to look at.
#include <fmt/format.h>

#include "services/campaign/collector_impl.h"
#include "services/core/log.h"
#include "services/spec/attempt_outcome.h"

namespace etude::campaign {

// Leased to who has nothing in hand.
std::optional<Assignment> Collector::Impl::MakeAgain(const bus::WorkRequest& request) {
  if (all_done || request.working_on != 0 || table.Holds(request.worker)) return std::nullopt;
  if (leasing != Leasing::kOn && !rechecks.Holds(request.worker)) return std::nullopt;
  return rechecks.Request(request.worker, HostOf(request.worker), MonotonicClock::now());
}

// "": it has not asked yet.
std::string Collector::Impl::HostOf(const std::string& worker) const {
  const auto host = hosts.find(worker);
  return host == hosts.end() ? "" : host->second;
}

// Everything is committed or given up, and what should be made again elsewhere has been, or nobody is there for it.
// Once that was so it stays so: who comes back later is sent home.
bool Collector::Impl::AllDone() {
  if (all_done || !table.complete()) return all_done;
  if (leasing != Leasing::kOn) return all_done = rechecks.in_flight() + rechecks.waiting() == 0;  // `resume` may come
  const Time now = MonotonicClock::now();
  std::set<std::string> there;
  for (const auto& [worker, time] : heard)
    if (const auto host = hosts.find(worker);
        host != hosts.end() && !dismissed.contains(worker) && now - time < kPresence)
      there.insert(host->second);
  return all_done = !rechecks.Awaits(there, now);
}

// Said once: when the campaign has run for a while and nobody has begun with any, else at the end.
void Collector::Impl::SayUnchecked(bool at_end) {
  constexpr std::chrono::seconds kLong{60};
  const MutexLock lock(mutex);
  const std::uint64_t unchecked = rechecks.waiting() + rechecks.dropped();
  if (said_unchecked || unchecked == 0) return;
  const Time now = MonotonicClock::now();
  if (!at_end && rechecks.in_flight() + counters.rechecked > 0) return;
  if (!at_end && now - started < kLong) return;
  said_unchecked = true;
  Log().warn("{} episodes of campaign={} {} made again on another host than their own (recheck: {}): {}", unchecked,
             spec.name, at_end ? "were not" : "wait to be", spec.recheck,
             at_end ? "no worker of one was there for them" : "start a worker there; the campaign completes without");
}

// A result of a lease to make an episode again, by the SHA-256 of its bytes; nothing where it is none.
std::optional<bus::Verdict> Collector::Impl::JudgeAgain(const bus::BlobManifest& manifest) {
  std::optional<RecheckTable::Lease> lease;
  const std::string sha256 = DigestOf(manifest);
  {
    const MutexLock lock(mutex);
    lease = rechecks.Take(manifest.token, manifest.sender, MonotonicClock::now());
    if (!lease) return std::nullopt;
    HearAgain(manifest.sender);
    ++counters.rechecked;
    if (lease->episode.sha256 == sha256) return bus::Verdict{bus::AckKind::kDuplicate, ""};
  }
  return bus::Verdict{bus::AckKind::kRefused, TellMismatch(*lease, "sha256", sha256)};
}

// An attempt that gave an episode there and none here is a difference, too. True when it was one of these.
bool Collector::Impl::OnReportAgain(const bus::AttemptReport& report, const std::string& outcome) {
  std::optional<RecheckTable::Lease> lease;
  {
    const MutexLock lock(mutex);
    if (report.outcome == kReleased) return rechecks.Release(report.token, report.worker);
    lease = rechecks.Take(report.token, report.worker, MonotonicClock::now());
    if (!lease) return false;
    HearAgain(report.worker);
    ++counters.rechecked;
  }
  (void)TellMismatch(*lease, "outcome", outcome);
  return true;
}

// Returns it in words. The line in attempts.jsonl does not count against the index.
std::string Collector::Impl::TellMismatch(const RecheckTable::Lease& lease, const char* what,
                                          const std::string& found) {
  const CommittedEpisode& episode = lease.episode;
  const std::string text = fmt::format(
      "episode {} attempt {}: host '{}' (worker {}) made other bytes than host '{}' (worker {}), whose are committed: "
      "{} {}, committed sha256 {}; what is committed stays",
      episode.index, episode.attempt, lease.host, lease.worker, episode.host, episode.worker, what, found,
      episode.sha256);
  {
    const MutexLock lock(mutex);
    ++counters.mismatched;
  }
  Log().error("two hosts differ campaign={} {}: compare what `etude worker --fingerprint` prints on both", spec.name,
              text);
  const OrderedJson details{{"host", lease.host},
                            {"worker", lease.worker},
                            {what, found},
                            {"committed_host", episode.host},
                            {"committed_worker", episode.worker},
                            {"committed_sha256", episode.sha256}};
  const Status recorded = sink->RecordFailure(episode.index, episode.attempt, kRecheckMismatch, JsonText(details));
  if (!recorded) Log().warn("cannot record that two hosts differ: {}", recorded.error().message);
  index_dirty = true;
  return text;
}

}  // namespace etude::campaign
