// SPDX-License-Identifier: Apache-2.0
// The collector's commit threads: episodes were received and hashed, and are checked, made durable and acknowledged
// here, in groups.
#include <fmt/format.h>

#include <algorithm>
#include <thread>

#include "services/campaign/collector_impl.h"
#include "services/core/cores.h"
#include "services/core/crash_point.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/episode/attempt_times.h"
#include "services/episode/bounded_json.h"
#include "services/episode/codec.h"
#include "services/spec/attempt_outcome.h"
#include "services/spec/episode_plan.h"
#include "services/store/filter_keys.h"

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
  if (meta->contains("fingerprint") && (*meta)["fingerprint"].is_string())
    facts.fingerprint = (*meta)["fingerprint"].get<std::string>().substr(0, kLongestName);
  if (meta->contains("timings")) facts.timings = TimesOf((*meta)["timings"]);
  return facts;
}

}  // namespace

std::string DigestOf(const bus::BlobManifest& manifest) {
  Sha256Digest digest{};
  std::copy_n(manifest.sha256.begin(), std::min(manifest.sha256.size(), digest.size()), digest.begin());
  return ToHex(digest);
}

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
  const auto index = table.IndexOf(manifest.token);
  // in somebody else's name, or with a token that somebody else was told: it costs nobody anything
  if (!index || !table.WentTo(*index, manifest.sender)) return;
  constexpr std::size_t kMostRemembered = 10'000;
  if (unfit.size() > kMostRemembered) unfit.clear();
  Unfit& mistakes = unfit[manifest.sender];
  ++mistakes.in_a_row;
  mistakes.reason = reason;
  table.Fail(*index, Retry::kSameAttempt);
  ++counters.failures[kUnfitEpisode];
}

// What did not even come: the same to its worker, who would else be told to make it again and again.
void Collector::Impl::CountRefused() {
  for (const auto& [manifest, reason] : topics.episodes.TakeRefused()) {
    const MutexLock lock(mutex);
    HearAgain(manifest.sender);
    CountUnfit(manifest, reason);
  }
}

// An episode that is made durable now, by the thread that claimed its index.
struct Collector::Impl::Claim {
  bus::ReceivedBlob blob;
  EpisodeView view;  // into the blob
};

// What to answer at once; nothing where its index is claimed by it, or by another one that came before: `blob` then
// waits until that one is settled.
std::optional<bus::Verdict> Collector::Impl::Judge(bus::ReceivedBlob& blob, const Result<EpisodeView>& view) {
  const Status fits = view ? CheckEpisode(view->episode) : Status(Fail(view.error()));
  const MutexLock lock(mutex);
  HearAgain(blob.manifest.sender);
  if (!fits) {
    CountUnfit(blob.manifest, fits.error().message);
    Log().warn("refused an episode worker={}: {}", blob.manifest.sender, fits.error().message);
    return bus::Verdict{bus::AckKind::kRefused, fits.error().message};
  }
  const Episode& episode = view->episode;
  if (const auto before = committing.find(episode.index); before != committing.end()) {
    before->second.push_back(std::move(blob));
    return std::nullopt;
  }
  switch (table.Check(episode.index, episode.attempt, blob.manifest.token)) {
    case LeaseValidity::kCurrent:
      if (!table.WentTo(episode.index, blob.manifest.sender)) break;
      committing.try_emplace(episode.index);
      return std::nullopt;
    case LeaseValidity::kCommitted:
      ++counters.duplicates;
      return bus::Verdict{bus::AckKind::kDuplicate, ""};
    case LeaseValidity::kStale:
      break;
  }
  ++counters.stale_results;
  return bus::Verdict{bus::AckKind::kRefused,
                      fmt::format("index {} was leased again, or to another worker: token {} is old, or not this one's",
                                  episode.index, blob.manifest.token)};
}

void Collector::Impl::Acknowledge(const bus::BlobManifest& manifest, const bus::Verdict& verdict) {
  if (const Status sent = topics.episodes.Acknowledge(manifest, verdict); !sent)
    Log().warn("cannot acknowledge to worker={}: {}", manifest.sender, sent.error().message);
}

void Collector::Impl::OnEpisode(bus::ReceivedBlob blob, std::vector<Claim>& claims) {
  if (const auto verdict = JudgeAgain(blob.manifest)) return Acknowledge(blob.manifest, *verdict);
  auto view = ViewEpisode(blob.bytes);
  if (const auto verdict = Judge(blob, view)) return Acknowledge(blob.manifest, *verdict);
  if (!blob.bytes.empty()) claims.push_back({std::move(blob), std::move(*view)});  // else it waits for another one
}

// The index is free again. Without a verdict (a stop came before the disk) nobody is answered: it is sent again, or
// made again.
void Collector::Impl::Settle(const Claim& claim, const std::optional<bus::Verdict>& verdict) {
  const std::uint64_t index = claim.view.episode.index;
  const std::string& worker = claim.blob.manifest.sender;
  std::vector<bus::ReceivedBlob> waiting;
  {
    const MutexLock lock(mutex);
    waiting = std::move(committing[index]);
    committing.erase(index);
    if (verdict && verdict->kind == bus::AckKind::kDone) {
      table.Commit(index);
      unfit.erase(worker);
      // Where its lease went, not what came with the bytes: who names another host would make its own again. An earlier
      // start of this collector may have leased it.
      const auto leased = leased_to.find(worker);
      const std::string& address = leased == leased_to.end() ? claim.blob.manifest.host : leased->second.address;
      rechecks.Add(
          {index, claim.view.episode.attempt, worker, bus::HostOfAddress(address), DigestOf(claim.blob.manifest)},
          MonotonicClock::now());
      policy_away_since.reset();
      commits.push_back(MonotonicClock::now());
      index_dirty = true;
    } else if (verdict) {
      CountUnfit(claim.blob.manifest, verdict->reason);
    }
  }
  if (verdict) {
    const bool promised = verdict->kind == bus::AckKind::kDone;
    if (promised) CrashPoint("collector.before_ack", index);
    Acknowledge(claim.blob.manifest, *verdict);
    if (promised) CrashPoint("collector.after_ack", index);
  }
  for (auto& blob : waiting) Enqueue(std::move(blob));
}

// Answers those that are decided; what the disk did not take stays in `claims`. False when nothing is left.
bool Collector::Impl::SettleOrKeep(std::vector<Claim>& claims, const std::vector<Status>& statuses) {
  std::vector<Claim> kept;
  std::string error;
  for (std::size_t i = 0; i < claims.size(); ++i) {
    const Code code = statuses[i] ? Code::kInternal : statuses[i].error().code;
    if (statuses[i]) {
      Settle(claims[i], bus::Verdict{bus::AckKind::kDone, ""});
    } else if (code == Code::kInvalidArgument || code == Code::kCorrupt) {
      Settle(claims[i], bus::Verdict{bus::AckKind::kRefused, statuses[i].error().message});
    } else {
      error = statuses[i].error().message;
      kept.push_back(std::move(claims[i]));
    }
  }
  claims = std::move(kept);
  TellOfDisk(error);
  return !claims.empty();
}

// Each commit thread meets a full disk at another episode, again and again: that it waits is said once, and that it
// goes on when none of them waits any more.
void Collector::Impl::TellOfDisk(const std::string& error) {
  const MutexLock lock(mutex);
  const bool waited = !disk_errors.empty();
  if (error.empty())
    disk_errors.erase(std::this_thread::get_id());
  else
    disk_errors[std::this_thread::get_id()] = error;
  if (!waited && !error.empty()) Log().error("committing waits, nothing is lost, it is tried again: {}", error);
  if (waited && disk_errors.empty()) Log().info("the disk takes episodes again");
  counters.error = disk_errors.empty() ? "" : disk_errors.begin()->second;
}

void Collector::Impl::CommitUntilDurable(std::vector<Claim> claims) {
  while (!claims.empty()) {
    std::vector<store::ArrivedEpisode> group;
    for (const Claim& claim : claims) {
      group.push_back({&claim.view, DigestOf(claim.blob.manifest), FactsOf(claim.blob.manifest)});
    }
    if (!SettleOrKeep(claims, sink->CommitGroup(group))) return;
    // leases stay alive meanwhile, and the receiver takes no more than its bound
    if (!Stopping()) WaitForStop(options.retry_commit);
    if (!Stopping()) continue;
    for (const Claim& claim : claims) Settle(claim, std::nullopt);
    return;
  }
}

std::size_t Collector::Impl::CommitThreads() const {
  if (options.commit_threads > 0) return options.commit_threads;
  return static_cast<std::size_t>(std::min(Cores(), 4));
}

// A share of what is there, so that all threads have work and each group saves fsyncs. Empty: it is over.
std::vector<bus::ReceivedBlob> Collector::Impl::NextBatch() {
  constexpr std::size_t kLargestGroup = 16;
  const MutexLock lock(queue_mutex);
  while (queue.empty() && !closing) queue_changed.Wait(queue_mutex);
  std::vector<bus::ReceivedBlob> batch;
  if (closing) return batch;
  const std::size_t threads = CommitThreads();
  for (std::size_t n = std::min((queue.size() + threads - 1) / threads, kLargestGroup); n > 0; --n) {
    batch.push_back(std::move(queue.front()));
    queue.pop_front();
  }
  return batch;
}

void Collector::Impl::CommitLoop() {
  for (auto batch = NextBatch(); !batch.empty(); batch = NextBatch()) {
    std::vector<Claim> claims;
    for (auto& blob : batch) OnEpisode(std::move(blob), claims);
    CommitUntilDurable(std::move(claims));
  }
}

void Collector::Impl::Enqueue(bus::ReceivedBlob blob) {
  {
    const MutexLock lock(queue_mutex);
    queue.push_back(std::move(blob));
  }
  queue_changed.NotifyOne();
}

void Collector::Impl::Close() {
  {
    const MutexLock lock(queue_mutex);
    closing = true;
  }
  queue_changed.NotifyAll();
  over.NotifyAll();
}

// True when it is time, or a key is wished; false when it is over.
bool Collector::Impl::WaitForIndex(Time due) {
  const MutexLock lock(queue_mutex);
  while (!closing && key_wishes.empty() && MonotonicClock::now() < due)
    over.WaitFor(queue_mutex, due - MonotonicClock::now());
  return !closing;
}

std::optional<Collector::Impl::KeyWish> Collector::Impl::FirstWish() {
  const MutexLock lock(queue_mutex);
  return key_wishes.empty() ? std::nullopt : std::optional(key_wishes.front());
}

Status Collector::Impl::WriteKey(const KeyWish& wish, std::size_t& count) {
  ETUDE_ASSIGN_OR_RETURN(const auto episodes, store::ParseIndices(wish.episodes, spec.episodes));
  count = episodes.size();
  return sink->WriteFilterKey(wish.name, episodes);
}

// The control thread says how it went.
void Collector::Impl::WriteWishedKeys() {
  while (const auto wish = FirstWish()) {
    std::size_t count = 0;
    const Status written = WriteKey(*wish, count);
    {
      const MutexLock lock(mutex);
      control_id = wish->control_id;
      control_refusal = written ? "" : written.error().message;
    }
    if (written)
      Log().info("filter key '{}' has {} episodes", wish->name, count);
    else
      Log().warn("cannot write a filter key: {}", written.error().message);
    answered = true;
    const MutexLock lock(queue_mutex);
    key_wishes.pop_front();
  }
}

// Of what takes longer the more there is, most is left for the end; at most a twentieth of the time goes into it.
void Collector::Impl::IndexNowAndThen() {
  constexpr int kShare = 20;
  Time due = MonotonicClock::now() + options.index_every;
  while (WaitForIndex(due)) {
    WriteWishedKeys();
    const Time begin = MonotonicClock::now();
    if (begin < due) continue;
    TryIndex(false);
    const Time end = MonotonicClock::now();
    due = end + std::max<Time::duration>(options.index_every, kShare * (end - begin));
  }
}

Status Collector::Impl::WriteIndex(bool at_end) {
  if (!index_dirty.exchange(false) && (!at_end || index_whole)) return {};
  index_whole = at_end;
  const Status written = at_end ? sink->WriteIndex() : sink->WriteProgress();
  if (!written) index_dirty = true;
  return written;
}

void Collector::Impl::TryIndex(bool at_end) {
  if (const Status written = WriteIndex(at_end); !written)
    Log().warn("cannot write the dataset's index, it is tried again: {}", written.error().message);
}

// What a collector leaves is whole: it waits for the disk as it does for an episode's sake, until it is stopped.
Status Collector::Impl::WriteLastIndex() {
  while (true) {
    const Status written = WriteIndex(true);
    TellOfDisk(written ? "" : written.error().message);
    if (written || written.error().code != Code::kUnavailable || Stopping()) return written;
    WaitForStop(options.retry_commit);
  }
}

// Until every worker that is there has been told (or has gone), for at most `drain` since it is heard; for those that
// were there within the last minute and have not been heard since the end, because a link is down, for at most `away`.
void Collector::Impl::Drain() {
  const Time begin = MonotonicClock::now();
  std::map<std::string, Time> back;
  while (!Stopping()) {
    {
      const MutexLock lock(mutex);
      const Time now = MonotonicClock::now();
      const bool waiting = std::any_of(heard.begin(), heard.end(), [&](const auto& item) ETUDE_REQUIRES(mutex) {
        if (dismissed.contains(item.first)) return false;
        if (item.second < begin) return now - begin < std::max(options.drain, options.away);
        return now - back.try_emplace(item.first, now).first->second < options.drain;
      });
      if (!waiting) return;
    }
    // a late duplicate is still answered
    if (auto blob = topics.episodes.Receive(50ms)) Enqueue(std::move(*blob));
  }
}

}  // namespace etude::campaign
