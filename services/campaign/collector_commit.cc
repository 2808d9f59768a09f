// SPDX-License-Identifier: Apache-2.0
// The collector's commit thread: an episode is received, checked, made durable, acknowledged.
#include <fmt/format.h>

#include <algorithm>

#include "services/campaign/collector_impl.h"
#include "services/campaign/worker_client.h"
#include "services/core/log.h"
#include "services/episode/bounded_json.h"
#include "services/episode/codec.h"
#include "services/spec/episode_plan.h"

namespace etude::campaign {

using namespace std::chrono_literals;

namespace {

// What the worker says of itself beside the episode. It decides nothing: what is not understood is left out.
store::CommitFacts FactsOf(const bus::BlobManifest& manifest) {
  constexpr std::size_t kLongest = 16 << 10;
  constexpr std::size_t kLongestName = 128;
  store::CommitFacts facts{.worker = manifest.sender};
  const auto meta = manifest.meta_json.size() > kLongest ? std::nullopt : ParseBoundedJson(manifest.meta_json, 4);
  if (!meta || !meta->is_object()) return facts;
  if (meta->contains("host") && (*meta)["host"].is_string())
    facts.host = (*meta)["host"].get<std::string>().substr(0, kLongestName);
  if (meta->contains("timings")) facts.timings = TimesOf((*meta)["timings"]);
  return facts;
}

}  // namespace

Status Collector::Impl::CheckEpisode(const Episode& episode) const {
  const auto wrong = [&](const char* what, const auto& found, const auto& expected) {
    return Fail(Code::kInvalidArgument, fmt::format("episode {} of campaign '{}': {} is {}, expected {}", episode.index,
                                                    spec.name, what, found, expected));
  };
  if (episode.campaign != spec.name) return wrong("campaign", episode.campaign, spec.name);
  if (episode.index >= spec.episodes) return wrong("index", episode.index, spec.episodes);
  if (episode.version != std::to_string(options.content))
    return wrong("content number", episode.version, std::to_string(options.content));
  if (episode.spec_sha256 != spec_sha256) return wrong("spec", episode.spec_sha256, spec_sha256);
  const EpisodePlan plan = PlanEpisode(spec, episode.index, episode.attempt, WeightsAt(episode.index));
  if (const std::string made_with = WeightsOf(episode.details); made_with != plan.weights_sha256)
    return wrong("the hash of its sampling weights", made_with, plan.weights_sha256);
  if (episode.seed != plan.seed) return wrong("seed", episode.seed, plan.seed);
  if (episode.task != plan.task.text()) return wrong("task", episode.task, plan.task.text());
  if (spec.mode == "demonstrate" && !episode.success) return wrong("outcome", episode.outcome, "success");
  return {};
}

// What does not fit is its worker's fault: it counts against that one, which is sent away when it goes on like this
// (WhySentAway). The same attempt again: which attempt is committed, and whether one is, must not depend on a worker.
void Collector::Impl::CountUnfit(const bus::BlobManifest& manifest, const std::string& reason) {
  ++counters.refused;
  constexpr std::size_t kMostRemembered = 10'000;
  if (unfit.size() > kMostRemembered) unfit.clear();
  Unfit& mistakes = unfit[manifest.sender];
  ++mistakes.in_a_row;
  mistakes.reason = reason;
  const auto index = table.IndexOf(manifest.token);
  if (!index) return;
  table.Fail(*index, LeaseTable::Retry::kSameAttempt);
  ++counters.failures[kUnfitEpisode];
}

std::optional<bus::Verdict> Collector::Impl::Judge(const bus::ReceivedBlob& blob, Episode& episode) {
  auto decoded = DecodeEpisode(blob.bytes);
  const Status fits = decoded ? CheckEpisode(*decoded) : Status(Fail(decoded.error()));
  const MutexLock lock(mutex);
  heard[blob.manifest.sender] = MonotonicClock::now();
  if (!fits) {
    CountUnfit(blob.manifest, fits.error().message);
    Log().warn("refused an episode worker={}: {}", blob.manifest.sender, fits.error().message);
    return bus::Verdict{bus::AckKind::kRefused, fits.error().message};
  }
  episode = std::move(*decoded);
  switch (table.Check(episode.index, episode.attempt, blob.manifest.token)) {
    case LeaseValidity::kCurrent:
      return std::nullopt;
    case LeaseValidity::kCommitted:
      ++counters.duplicates;
      return bus::Verdict{bus::AckKind::kDuplicate, ""};
    case LeaseValidity::kStale:
      break;
  }
  ++counters.stale_results;
  return bus::Verdict{bus::AckKind::kRefused,
                      fmt::format("index {} was leased again: token {} is old", episode.index, blob.manifest.token)};
}

std::optional<bus::Verdict> Collector::Impl::CommitUntilDurable(const Episode& episode,
                                                                const store::CommitFacts& facts) {
  while (true) {
    const Status committed = [&]() -> Status {
      const MutexLock lock(sink_mutex);
      return sink->Commit(episode, facts);
    }();
    {
      const MutexLock lock(mutex);
      if (committed) {
        counters.error.clear();
        return bus::Verdict{bus::AckKind::kDone, ""};
      }
      const Error& error = committed.error();
      if (error.code == Code::kInvalidArgument || error.code == Code::kCorrupt)
        return bus::Verdict{bus::AckKind::kRefused, error.message};
      if (counters.error != error.message)
        Log().error("committing waits, nothing is lost, it is tried again: {}", error.message);
      counters.error = error.message;
    }
    // without the lock, so that leases stay alive meanwhile
    if (Stopping()) return std::nullopt;
    WaitForStop(options.retry_commit);
    if (Stopping()) return std::nullopt;
  }
}

void Collector::Impl::OnEpisode(const bus::ReceivedBlob& blob) {
  Episode episode;
  std::optional<bus::Verdict> verdict = Judge(blob, episode);
  if (!verdict) {
    verdict = CommitUntilDurable(episode, FactsOf(blob.manifest));
    // not durable and not at fault: no answer, so that it is sent or made again
    if (!verdict) return;
    const MutexLock lock(mutex);
    if (verdict->kind == bus::AckKind::kDone) {
      table.Commit(episode.index);
      unfit.erase(blob.manifest.sender);
      policy_away_since.reset();
      commits.push_back(MonotonicClock::now());
      index_dirty = true;
    } else {
      CountUnfit(blob.manifest, verdict->reason);
    }
  }
  if (const Status sent = episodes.Acknowledge(blob.manifest, *verdict); !sent)
    Log().warn("cannot acknowledge to worker={}: {}", blob.manifest.sender, sent.error().message);
}

void Collector::Impl::WriteIndex() {
  if (!index_dirty) return;
  const MutexLock lock(sink_mutex);
  const Status written = sink->WriteIndex();
  if (written)
    index_dirty = false;
  else
    Log().warn("cannot write the dataset's index, it is tried again: {}", written.error().message);
}

// Until every worker that is there has been told (or has gone), for at most `drain`; for those that were there within
// the last minute and have not been heard since the end, because a link is down, for at most `away`.
void Collector::Impl::Drain() {
  const Time begin = MonotonicClock::now();
  while (!Stopping()) {
    {
      const MutexLock lock(mutex);
      const Time now = MonotonicClock::now();
      const bool waiting = std::any_of(heard.begin(), heard.end(), [&](const auto& item) ETUDE_REQUIRES(mutex) {
        if (dismissed.contains(item.first)) return false;
        const bool there = item.second >= begin;
        return now - begin < (there ? options.drain : std::max(options.drain, options.away));
      });
      if (!waiting) return;
    }
    // a late duplicate is still answered
    if (auto blob = episodes.Receive(50ms)) OnEpisode(*blob);
  }
}

}  // namespace etude::campaign
