// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/collector.h"

#include <fmt/format.h>

#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "services/campaign/collector_impl.h"
#include "services/campaign/history.h"
#include "services/campaign/process.h"
#include "services/core/command.h"
#include "services/core/disk_wait.h"
#include "services/core/log.h"
#include "services/core/service_manager.h"
#include "services/core/without_throwing.h"
#include "services/spec/attempt_outcome.h"

namespace etude::campaign {

using namespace std::chrono_literals;

void Collector::Impl::Announce(bool complete) {
  bus::CampaignAnnouncement announcement;
  announcement.campaign = spec.name;
  announcement.campaign_id = id;
  OrderedJson json = ToJson(spec);
  json.erase("recheck");  // no matter of the workers', and those of before it would not know it
  if (spec.obstacle.clearance == ObstacleSpec().clearance) json["obstacle"].erase("clearance");  // nor this one
  announcement.spec_json = json.dump();
  announcement.spec_sha256 = spec_sha256;
  announcement.version = Version();
  announcement.content = options.content;
  announcement.epoch = epoch;
  announcement.policy_id = options.policy_id;
  announcement.complete = complete;
  if (const Status written = topics.announcements.Write(announcement); !written)
    Log().warn("cannot announce campaign={}: {}", spec.name, written.error().message);
}

void Collector::Impl::Guard(const char* thread, const std::function<void()>& work) {
  const Status done = WithoutThrowing([&]() -> Status {
    work();
    return {};
  });
  if (done) return;
  const std::string& why = done.error().message;
  Log().error("the {} thread failed: {}", thread, why);
  {
    const MutexLock lock(mutex);
    if (!ended_by)
      ended_by = Error{Code::kInternal,
                       fmt::format("collect '{}': its {} thread failed: {}; what is committed is kept, start it again",
                                   spec.name, thread, why)};
  }
  stop.store(true);
}

std::optional<Error> Collector::Impl::EndedBy() {
  const MutexLock lock(mutex);
  return ended_by;
}

bool Collector::Impl::Complete() {
  const MutexLock lock(mutex);
  return AllDone();
}

Collector::Collector(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Collector::Collector(Collector&&) noexcept = default;
Collector& Collector::operator=(Collector&&) noexcept = default;
Collector::~Collector() = default;

Result<Collector> Collector::Open(const bus::Participant& participant, const CampaignSpec& spec, const Path& folder,
                                  const CollectorOptions& options) {
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  ETUDE_ASSIGN_OR_RETURN(auto sink, OpenSink(folder, spec, options.subject));
  return Open(participant, spec, std::move(sink), options);
}

namespace {

// A folder stays what it began as: episodes of another shard in it would be in two datasets.
Status CheckShard(const CampaignSpec& spec, const EpisodeSink& sink, const Shard& shard) {
  const std::string folder = sink.folder().string();
  const auto known = KnownShard(sink.folder());
  if (known && *known != shard.text())
    return Fail(
        Code::kInvalidArgument,
        fmt::format("'{}' is shard {} of campaign '{}': go on with it by --shard {}, or collect {} into another "
                    "folder (`etude dataset link` makes one dataset of all shards)",
                    folder, *known, spec.name, *known, shard.whole() ? "all" : "shard " + shard.text()));
  if (shard.whole()) return {};
  if (spec.mode != "demonstrate" || spec.adaptive_sampling.on())
    return Fail(Code::kInvalidArgument,
                fmt::format("campaign '{}': --shard {}: {} has one collector, without --shard", spec.name, shard.text(),
                            spec.mode != "demonstrate" ? "an evaluation" : "a campaign with adaptive_sampling"));
  for (const std::uint64_t index : sink.committed())
    if (!shard.Has(index))
      return Fail(
          Code::kInvalidArgument,
          fmt::format("'{}' has episode {}, which is none of shard {}: collect the shard into another folder, or "
                      "go on without --shard",
                      folder, index, shard.text()));
  return {};
}

// Says who this is, after making sure that nobody else is it; its epoch is then larger than any before.
Result<bus::Announcement> ClaimName(const bus::Participant& participant, const CampaignSpec& spec, const Path& folder,
                                    const CollectorOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(const Identity identity, OpenIdentity(folder, options.claim));
  ETUDE_ASSIGN_OR_RETURN(const std::uint64_t last, LastEpoch(folder));
  bus::Presence presence = bus::MakePresence(bus::PresenceKind::kCampaign, spec.name, identity.id, folder.string());
  presence.content = options.content;
  presence.epoch = last + 1;
  if (!options.shard.whole()) {
    presence.shard = options.shard.number;
    presence.shards = options.shard.count;
    presence.spec_sha256 = SpecHash(spec);
  }
  ETUDE_ASSIGN_OR_RETURN(auto announcement, bus::Announcement::Open(participant, presence, options.claim));
  // as a full disk is waited for later: a service that ends for it is started again a few times only
  ETUDE_RETURN_IF_ERROR(CheckMayWrite(folder));
  bool again = false;
  ETUDE_RETURN_IF_ERROR(WriteWhenThereIsRoom("the collector's epoch", [&]() -> Status {
    const auto epoch = announcement.presence().epoch;
    // it is there, and its name may not be durable yet
    if (std::exchange(again, true) && LastEpoch(folder).value_or(0) == epoch) return SyncFolder(folder);
    return RememberEpoch(folder, epoch);
  }));
  if (!options.shard.whole()) ETUDE_RETURN_IF_ERROR(RememberShard(folder, options.shard.text()));
  return announcement;
}

LeaseTable MakeTable(const CampaignSpec& spec, const EpisodeSink& sink, const History& history,
                     const CollectorOptions& options, std::uint64_t epoch) {
  LeaseTable table({.total = spec.episodes,
                    .shard = options.shard,
                    .max_attempts = static_cast<std::uint32_t>(spec.max_attempts),
                    .one_attempt = RetryOf(spec, kKillsWorkers) == Retry::kNever,
                    .max_in_flight = options.max_in_flight,
                    .duration = options.lease,
                    .epoch = epoch});
  for (const std::uint64_t index : sink.committed()) table.RestoreCommitted(index);
  for (const auto& [index, past] : history.indices) table.RestoreFailures(index, past.failures, past.next_attempt);
  return table;
}

CollectorProgress CountersOf(const History& history, const store::SamplingJournal& journal) {
  CollectorProgress counters;
  counters.failures = history.failures;
  if (auto differed = counters.failures.extract(kRecheckMismatch)) counters.mismatched = differed.mapped();
  counters.reweighted = journal.entries().size();
  if (counters.reweighted > 0) counters.reweighted_from = journal.entries().back().from_index;
  return counters;
}

}  // namespace

Result<CollectorTopics> CollectorTopics::Open(const bus::Participant& participant, const bus::Owner& owner,
                                              const CollectorOptions& options) {
  const std::string partition = owner.partition();
  ETUDE_ASSIGN_OR_RETURN(auto announcements, bus::Writer<bus::CampaignAnnouncement>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto statuses, bus::Writer<bus::CampaignStatus>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto requests, bus::Reader<bus::WorkRequest>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto reports, bus::Reader<bus::AttemptReport>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto heartbeats, bus::Reader<bus::WorkerStatus>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto errors, bus::Reader<bus::ValidationErrors>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto controls, bus::Reader<bus::CampaignControl>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto episodes,
                         bus::BlobReceiver::Open(participant, owner, "episode", {.max_memory = options.max_memory}));
  bus::AddressedWriters<bus::Lease> leases(participant, partition);
  return CollectorTopics{std::move(announcements), std::move(leases),   std::move(statuses),
                         std::move(requests),      std::move(reports),  std::move(heartbeats),
                         std::move(errors),        std::move(controls), std::move(episodes)};
}

Result<Collector> Collector::Open(const bus::Participant& participant, const CampaignSpec& spec,
                                  std::unique_ptr<EpisodeSink> sink, const CollectorOptions& options) {
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  ETUDE_RETURN_IF_ERROR(CheckShard(spec, *sink, options.shard));
  ETUDE_ASSIGN_OR_RETURN(auto presence, ClaimName(participant, spec, sink->folder(), options));
  const std::string id = presence.presence().id;
  const std::uint64_t epoch = presence.presence().epoch;
  // before anything is committed, files may still be mended: what failed before is tried again
  const bool begun = !sink->committed().empty();
  if (!begun) {
    ETUDE_RETURN_IF_ERROR(sink->ForgetFailures());
    ETUDE_RETURN_IF_ERROR(DropForgottenCount(sink->folder()));
  }
  const History history = ReadHistory(sink->folder(), spec);
  LeaseTable table = MakeTable(spec, *sink, history, options, epoch);
  ETUDE_ASSIGN_OR_RETURN(auto journal, store::SamplingJournal::Open(sink->folder(), spec));
  ETUDE_ASSIGN_OR_RETURN(auto topics, CollectorTopics::Open(participant, {spec.name, id}, options));
  std::unique_ptr<Impl> impl(new Impl{.spec = spec,
                                      .spec_sha256 = SpecHash(spec),
                                      .options = options,
                                      .id = id,
                                      .epoch = epoch,
                                      .presence = std::move(presence),
                                      .files_sha256 = begun ? KnownFiles(sink->folder()) : std::nullopt,
                                      .fingerprint = begun ? KnownFingerprint(sink->folder()) : std::nullopt,
                                      .topics = std::move(topics),
                                      .run_id = options.run_id,
                                      .sink = std::move(sink),
                                      .table = std::move(table),
                                      .counters = CountersOf(history, journal),
                                      .failed_attempts = history.total,
                                      .rechecks = RecheckTable({spec.recheck, spec.seed, epoch, options.lease}),
                                      .journal = std::move(journal)});
  return Collector(std::move(impl));
}

void Collector::Impl::ReceiveUntilOver() {
  std::optional<WatchedLoop> watched(std::in_place);
  while (!Stopping() && !Complete()) {
    watched->Moved();
    if (auto blob = topics.episodes.Receive(50ms)) Enqueue(std::move(*blob));
    CountRefused();
  }
  watched.reset();
  if (!Complete()) return;
  SayUnchecked(true);
  TryIndex(true);  // where the disk does not take it now, workers need not wait for that
  Announce(true);
  Drain();
}

Status Collector::Run() {
  Impl& impl = *impl_;
  {
    const MutexLock lock(impl.mutex);
    impl.started = MonotonicClock::now();
  }
  impl.Announce(impl.Complete());
  Log().info("campaign={}@{} episodes={} committed={} epoch={}{}", impl.spec.name, impl.id, progress().total,
             progress().committed, impl.epoch, impl.options.shard.whole() ? "" : " shard=" + impl.options.shard.text());
  std::thread control, indexer;
  std::vector<std::thread> committing;
  impl.Guard("starting threads", [&] {  // of which the system may have no more
    control = std::thread([&impl] { impl.Guard("control", [&impl] { impl.Control(); }); });
    indexer = std::thread([&impl] { impl.Guard("index", [&impl] { impl.IndexNowAndThen(); }); });
    for (std::size_t i = 0; i < impl.CommitThreads(); ++i)
      committing.emplace_back([&impl] { impl.Guard("commit", [&impl] { impl.CommitLoop(); }); });
  });

  impl.Guard("receiving", [&impl] { impl.ReceiveUntilOver(); });
  impl.Close();
  for (auto& thread : committing) thread.join();
  if (indexer.joinable()) indexer.join();
  Status indexed;
  impl.Guard("index", [&] {
    impl.WriteWishedKeys();
    indexed = impl.WriteLastIndex();
  });
  impl.finished.store(true);
  if (control.joinable()) control.join();
  const auto ended_by = impl.EndedBy();
  // one that failed stops itself: nobody wished it
  const bool stopped = !ended_by && impl.Stopping() && !impl.Complete();
  if (Status said = stopped ? RememberStop(impl.sink->folder()) : Status(); !said)
    Log().warn("remember that the campaign was stopped: {}", said.error().message);  // it is shown as silent then
  const CollectorProgress progress = this->progress();
  Log().info("campaign={} committed={}/{} given_up={} attempts={}", impl.spec.name, progress.committed, progress.total,
             progress.given_up, progress.attempts);
  if (ended_by) return Fail(*ended_by);
  if (!indexed)
    return Fail(
        indexed.error().Wrap(fmt::format("collect '{}': all that is committed is kept, start it again to write "
                                         "the dataset's index",
                                         impl.spec.name)));
  return {};
}

void Collector::Stop() { impl_->stop.store(true); }

const std::string& Collector::id() const { return impl_->id; }

CollectorProgress Collector::progress() const {
  const MutexLock lock(impl_->mutex);
  return impl_->Snapshot();
}

std::vector<std::string> Collector::TakeSilent() {
  const MutexLock lock(impl_->mutex);
  return std::exchange(impl_->silent, {});
}

void Collector::Revoke(const std::string& worker, int exit_code) {
  std::optional<Impl::Deadly> failed;
  {
    const MutexLock lock(impl_->mutex);
    failed = impl_->Revoke(worker, Crashed(exit_code), HowItEnded(exit_code));
    impl_->heard.erase(worker);
    impl_->motions.erase(worker);
    impl_->idle.erase(worker);
  }
  if (failed) impl_->Record(*failed);
}

}  // namespace etude::campaign
