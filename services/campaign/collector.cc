// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/collector.h"

#include <fmt/format.h>

#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "services/campaign/collector_impl.h"
#include "services/campaign/history.h"
#include "services/core/command.h"
#include "services/core/log.h"
#include "services/core/service_manager.h"
#include "services/core/without_throwing.h"

namespace etude::campaign {

using namespace std::chrono_literals;

void Collector::Impl::Announce(bool complete) {
  bus::CampaignAnnouncement announcement;
  announcement.campaign = spec.name;
  announcement.campaign_id = id;
  announcement.spec_json = ToJson(spec).dump();
  announcement.spec_sha256 = spec_sha256;
  announcement.version = Version();
  announcement.content = options.content;
  announcement.epoch = epoch;
  announcement.policy_id = options.policy_id;
  announcement.complete = complete;
  if (const Status written = announcements.Write(announcement); !written)
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

bool Collector::Impl::Complete() const {
  const MutexLock lock(mutex);
  return table.complete();
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

// Says who this is, after making sure that nobody else is it; its epoch is then larger than any before.
Result<bus::Announcement> ClaimName(const bus::Participant& participant, const CampaignSpec& spec, const Path& folder,
                                    const CollectorOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(const Identity identity, OpenIdentity(folder, options.claim));
  ETUDE_ASSIGN_OR_RETURN(const std::uint64_t last, LastEpoch(folder));
  bus::Presence presence = bus::MakePresence(bus::PresenceKind::kCampaign, spec.name, identity.id, folder.string());
  presence.content = options.content;
  presence.epoch = last + 1;
  ETUDE_ASSIGN_OR_RETURN(auto announcement, bus::Announcement::Open(participant, presence, options.claim));
  ETUDE_RETURN_IF_ERROR(RememberEpoch(folder, announcement.presence().epoch));
  return announcement;
}

}  // namespace

Result<Collector> Collector::Open(const bus::Participant& participant, const CampaignSpec& spec,
                                  std::unique_ptr<EpisodeSink> sink, const CollectorOptions& options) {
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  ETUDE_ASSIGN_OR_RETURN(auto presence, ClaimName(participant, spec, sink->folder(), options));
  const std::string id = presence.presence().id;
  const std::uint64_t epoch = presence.presence().epoch;
  LeaseTable table(
      {spec.episodes, static_cast<std::uint32_t>(spec.max_attempts), options.max_in_flight, options.lease, epoch});
  for (const std::uint64_t index : sink->committed()) table.RestoreCommitted(index);
  const History history = ReadHistory(sink->folder(), spec);
  for (const auto& [index, past] : history.indices) table.RestoreFailures(index, past.failures, past.next_attempt);
  ETUDE_ASSIGN_OR_RETURN(auto journal, store::SamplingJournal::Open(sink->folder(), spec));

  const bus::Owner owner{spec.name, id};
  const std::string partition = owner.partition();
  ETUDE_ASSIGN_OR_RETURN(auto announcements, bus::Writer<bus::CampaignAnnouncement>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto leases, bus::Writer<bus::Lease>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto statuses, bus::Writer<bus::CampaignStatus>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto requests, bus::Reader<bus::WorkRequest>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto reports, bus::Reader<bus::AttemptReport>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto heartbeats, bus::Reader<bus::WorkerStatus>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto errors, bus::Reader<bus::ValidationErrors>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto controls, bus::Reader<bus::CampaignControl>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto episodes,
                         bus::BlobReceiver::Open(participant, owner, "episode", {.max_memory = options.max_memory}));

  // before anything is committed, files may still be mended
  const auto files = sink->committed().empty() ? std::nullopt : KnownFiles(sink->folder());
  const auto fingerprint = sink->committed().empty() ? std::nullopt : KnownFingerprint(sink->folder());
  CollectorProgress counters;
  counters.failures = history.failures;
  counters.reweighted = journal.entries().size();
  if (counters.reweighted > 0) counters.reweighted_from = journal.entries().back().from_index;
  std::unique_ptr<Impl> impl(new Impl{.spec = spec,
                                      .spec_sha256 = SpecHash(spec),
                                      .options = options,
                                      .id = id,
                                      .epoch = epoch,
                                      .presence = std::move(presence),
                                      .files_sha256 = files,
                                      .fingerprint = fingerprint,
                                      .announcements = std::move(announcements),
                                      .leases = std::move(leases),
                                      .statuses = std::move(statuses),
                                      .requests = std::move(requests),
                                      .reports = std::move(reports),
                                      .heartbeats = std::move(heartbeats),
                                      .errors = std::move(errors),
                                      .controls = std::move(controls),
                                      .run_id = options.run_id,
                                      .episodes = std::move(episodes),
                                      .sink = std::move(sink),
                                      .table = std::move(table),
                                      .counters = std::move(counters),
                                      .failed_attempts = history.total,
                                      .journal = std::move(journal)});
  return Collector(std::move(impl));
}

void Collector::Impl::ReceiveUntilOver() {
  std::optional<WatchedLoop> watched(std::in_place);
  while (!Stopping() && !Complete()) {
    watched->Moved();
    if (auto blob = episodes.Receive(50ms)) Enqueue(std::move(*blob));
  }
  watched.reset();
  if (!Complete()) return;
  WriteIndex();
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
  Log().info("campaign={}@{} episodes={} committed={} epoch={}", impl.spec.name, impl.id, impl.spec.episodes,
             progress().committed, impl.epoch);
  std::thread control([&impl] { impl.Guard("control", [&impl] { impl.Control(); }); });
  std::thread indexer([&impl] { impl.Guard("index", [&impl] { impl.IndexNowAndThen(); }); });
  std::vector<std::thread> committing;
  for (std::size_t i = 0; i < impl.CommitThreads(); ++i)
    committing.emplace_back([&impl] { impl.Guard("commit", [&impl] { impl.CommitLoop(); }); });

  impl.Guard("receiving", [&impl] { impl.ReceiveUntilOver(); });
  impl.Close();
  for (auto& thread : committing) thread.join();
  indexer.join();
  impl.Guard("index", [&impl] { impl.WriteIndex(); });
  impl.finished.store(true);
  control.join();
  const CollectorProgress progress = this->progress();
  Log().info("campaign={} committed={}/{} given_up={} attempts={}", impl.spec.name, progress.committed, progress.total,
             progress.given_up, progress.attempts);
  const MutexLock lock(impl.mutex);
  if (impl.ended_by) return Fail(*impl.ended_by);
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

void Collector::Revoke(const std::string& worker) {
  const MutexLock lock(impl_->mutex);
  impl_->table.Revoke(worker);
  impl_->heard.erase(worker);
  impl_->motions.erase(worker);
}

}  // namespace etude::campaign
