// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/collector.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>

#include "services/bus/object_channel.h"
#include "services/bus/topic.h"
#include "services/campaign/history.h"
#include "services/campaign/lease_table.h"
#include "services/campaign/worker_client.h"
#include "services/core/command.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/episode/codec.h"

namespace etude::campaign {
namespace {

using namespace std::chrono_literals;
using Time = MonotonicClock::time_point;

// a worker that has not been heard for this long is not counted as present
constexpr auto kPresence = 5s;
// commits looked at for the rate
constexpr auto kRateWindow = 60s;

// how long Open looks for another collector of the same name
constexpr auto kLookAround = 300ms;

// Two collectors of one name would both judge every episode.
Status CheckAlone(const bus::Participant& participant, const std::string& campaign) {
  ETUDE_ASSIGN_OR_RETURN(auto reader, bus::Reader<bus::CampaignAnnouncement>::Open(participant, campaign));
  const auto deadline = MonotonicClock::now() + kLookAround;
  while (MonotonicClock::now() < deadline && reader.Wait(deadline - MonotonicClock::now()))
    for (const auto& other : reader.Take())
      if (other.campaign == campaign && !other.complete)
        return Fail(Code::kUnavailable,
                    fmt::format("collect campaign '{}': another collector of it is running on domain {}; end it, "
                                "or choose another `name` or --domain",
                                campaign, participant.domain()));
  return {};
}

double SecondsBetween(Time a, Time b) { return std::chrono::duration<double>(b - a).count(); }

}  // namespace

// Two threads: Run's own receives and commits episodes, `control` answers requests, reports and
// heartbeats, so that a slow disk never makes a lease expire. `mutex` guards what both touch.
struct Collector::Impl {
  CampaignSpec spec;
  std::string spec_sha256;
  CollectorOptions options;
  std::unique_ptr<EpisodeSink> sink;
  std::uint64_t epoch = 0;

  // control thread (and Open)
  std::optional<std::string> files_sha256;  // of the first worker
  bus::Writer<bus::CampaignAnnouncement> announcements;
  bus::Writer<bus::Lease> leases;
  bus::Writer<bus::CampaignStatus> statuses;
  bus::Reader<bus::WorkRequest> requests;
  bus::Reader<bus::AttemptReport> reports;
  bus::Reader<bus::WorkerStatus> heartbeats;
  // commit thread
  bus::ObjectReceiver episodes;

  std::atomic<bool> stop{false};
  std::atomic<bool> finished{false};  // the commit thread is done, control may end

  mutable std::mutex mutex;
  LeaseTable table;
  CollectorProgress counters;  // failures, stale_results, duplicates, refused, error
  std::uint64_t failed_attempts = 0;
  std::map<std::string, Time> heard;  // worker -> last sign of life
  std::set<std::string> dismissed;    // workers that were told kDone
  std::deque<Time> commits;           // of the last kRateWindow
  std::mutex sink_mutex;              // the sink is one thread at a time
  Time started = MonotonicClock::now();
  bool master_dirty = true;

  bool Stopping() const { return stop.load() || StopRequested(); }

  void Announce(bool complete);
  void Control();
  void TakeMessages();
  void OnRequest(const bus::WorkRequest& request);
  std::optional<std::string> WhyRefused(const bus::WorkRequest& request);
  void OnReport(const bus::AttemptReport& report);
  void OnHeartbeat(const bus::WorkerStatus& status);
  void PublishStatus();

  void OnEpisode(const bus::ReceivedObject& object);
  Status CheckEpisode(const Episode& episode) const;
  std::optional<bus::Verdict> Judge(const bus::ReceivedObject& object, Episode& episode);
  std::optional<bus::Verdict> CommitUntilDurable(const Episode& episode);
  void WriteMaster();
  bool Complete() const;
  void Linger();
  CollectorProgress Snapshot() const;  // needs mutex
};

void Collector::Impl::Announce(bool complete) {
  bus::CampaignAnnouncement announcement;
  announcement.campaign = spec.name;
  announcement.spec_json = ToJson(spec).dump();
  announcement.spec_sha256 = spec_sha256;
  announcement.version = Version();
  announcement.epoch = epoch;
  announcement.complete = complete;
  if (const Status written = announcements.Write(announcement); !written)
    Log().warn("cannot announce campaign={}: {}", spec.name, written.error().message);
}

bool Collector::Impl::Complete() const {
  const std::lock_guard lock(mutex);
  return table.complete();
}

// ---- control thread -------------------------------------------------------------------------------

void Collector::Impl::Control() {
  Time next_status = MonotonicClock::now();
  while (!finished.load()) {
    // a request is what a worker waits for; a report is always followed by one
    if (!requests.Wait(20ms) && StopRequested()) std::this_thread::sleep_for(5ms);
    TakeMessages();
    if (MonotonicClock::now() < next_status) continue;
    PublishStatus();
    next_status = MonotonicClock::now() + options.status_every;
  }
  TakeMessages();
  PublishStatus();
}

void Collector::Impl::TakeMessages() {
  // requests are taken first and answered last: a report that was sent before its worker's next request
  // is then always seen before it
  const auto asked = requests.Take();
  for (const auto& report : reports.Take()) OnReport(report);
  // heartbeats that queued while this process was suspended count before anything expires
  for (auto taken = heartbeats.Take(); !taken.empty(); taken = heartbeats.Take())
    for (const auto& status : taken) OnHeartbeat(status);
  {
    const std::lock_guard lock(mutex);
    if (const int lost = table.Expire(MonotonicClock::now()))
      Log().warn("leases expired without a word count={}", lost);
  }
  for (const auto& request : asked) OnRequest(request);
}

// Workers that would make other episodes than the rest.
std::optional<std::string> Collector::Impl::WhyRefused(const bus::WorkRequest& request) {
  if (request.version != Version())
    return fmt::format("campaign '{}' is collected by version {}, this worker is {}: install the same version",
                       spec.name, Version(), request.version);
  if (!files_sha256) {
    files_sha256 = request.files_sha256;
    const std::lock_guard lock(sink_mutex);
    if (const Status remembered = RememberFiles(sink->folder(), request.files_sha256); !remembered)
      Log().warn("after a restart the first worker's files will count: {}", remembered.error().message);
  }
  if (request.files_sha256 != *files_sha256)
    return fmt::format(
        "campaign '{}' began with other robot or object files than this worker has under the same paths "
        "(SHA-256 {}, here {}): copy them from where it began, or collect into another folder",
        spec.name, *files_sha256, request.files_sha256);
  return std::nullopt;
}

void Collector::Impl::OnRequest(const bus::WorkRequest& request) {
  if (request.campaign != spec.name) return;
  bus::Lease lease;
  lease.campaign = spec.name;
  lease.worker = request.worker;
  lease.request_id = request.request_id;
  lease.duration_ns = static_cast<std::uint64_t>(std::chrono::nanoseconds(options.lease).count());
  if (const auto why = WhyRefused(request)) {
    lease.kind = bus::LeaseKind::kRefused;
    lease.reason = *why;
    Log().warn("refused worker={}: {}", request.worker, *why);
  } else {
    const std::lock_guard lock(mutex);
    heard[request.worker] = MonotonicClock::now();
    // a stopping collector leases nothing new, and does not say that all is done
    const Grant grant = Stopping() ? Grant{} : table.Request(request.worker, MonotonicClock::now());
    lease.kind = grant.kind == Grant::Kind::kWork   ? bus::LeaseKind::kWork
                 : grant.kind == Grant::Kind::kDone ? bus::LeaseKind::kDone
                                                    : bus::LeaseKind::kWait;
    lease.index = grant.index;
    lease.attempt = grant.attempt;
    lease.token = grant.token;
    if (grant.kind == Grant::Kind::kDone) dismissed.insert(request.worker);
  }
  // an answer that is lost is asked for again
  if (const Status written = leases.Write(lease); !written)
    Log().warn("cannot answer worker={}: {}", request.worker, written.error().message);
}

void Collector::Impl::OnReport(const bus::AttemptReport& report) {
  if (report.campaign != spec.name || report.index >= spec.episodes) return;
  {
    const std::lock_guard lock(mutex);
    heard[report.worker] = MonotonicClock::now();
    if (table.Check(report.index, report.attempt, report.token) != Standing::kCurrent) {
      ++counters.stale_results;
      return;
    }
    if (report.outcome == kHandedBack) {
      table.HandBack(report.index);
      return;
    }
    const bool same = report.outcome == kPolicyError;
    table.Fail(report.index, same ? LeaseTable::Retry::kSameAttempt : LeaseTable::Retry::kNextAttempt);
    ++counters.failures[IsPlainName(report.outcome) ? report.outcome : "unnamed"];
    ++failed_attempts;
  }
  const std::lock_guard lock(sink_mutex);
  if (const Status recorded = sink->RecordFailure(report.index, report.attempt, report.outcome, report.details_json);
      !recorded)
    Log().warn("cannot record a failed attempt index={}: {}", report.index, recorded.error().message);
}

void Collector::Impl::OnHeartbeat(const bus::WorkerStatus& status) {
  if (status.campaign != spec.name) return;
  const std::lock_guard lock(mutex);
  const Time now = MonotonicClock::now();
  heard[status.worker] = now;
  if (status.token != 0) table.Renew(status.index, status.token, now);
}

CollectorProgress Collector::Impl::Snapshot() const {
  CollectorProgress progress = counters;
  const Time now = MonotonicClock::now();
  progress.committed = table.committed();
  progress.total = spec.episodes;
  progress.given_up = table.given_up();
  progress.attempts = table.committed() + failed_attempts;
  progress.lost_leases = table.lost();
  progress.complete = table.complete();
  progress.elapsed_s = SecondsBetween(started, now);
  for (const auto& [worker, time] : heard) progress.workers += now - time < kPresence && !dismissed.contains(worker);
  const double window = std::min(progress.elapsed_s, std::chrono::duration<double>(kRateWindow).count());
  const auto recent =
      std::count_if(commits.begin(), commits.end(), [&](Time time) { return now - time < kRateWindow; });
  if (window > 1) progress.episodes_per_minute = 60.0 * static_cast<double>(recent) / window;
  const auto left = progress.total - progress.committed - progress.given_up;
  if (progress.episodes_per_minute > 0)
    progress.eta_s = 60.0 * static_cast<double>(left) / progress.episodes_per_minute;
  return progress;
}

void Collector::Impl::PublishStatus() {
  bus::CampaignStatus status;
  {
    const std::lock_guard lock(mutex);
    const Time now = MonotonicClock::now();
    std::erase_if(heard, [&](const auto& item) { return now - item.second > 60s; });
    while (!commits.empty() && now - commits.front() > kRateWindow) commits.pop_front();
    const CollectorProgress progress = Snapshot();
    status.campaign = spec.name;
    status.committed = progress.committed;
    status.total = progress.total;
    status.attempts = progress.attempts;
    status.given_up = progress.given_up;
    status.workers = progress.workers;
    status.episodes_per_minute = progress.episodes_per_minute;
    status.eta_s = progress.eta_s;
    status.failures_json = OrderedJson(progress.failures).dump();
    status.error = progress.error;
  }
  if (const Status written = statuses.Write(status); !written)
    Log().debug("cannot publish the status: {}", written.error().message);
}

// ---- commit thread --------------------------------------------------------------------------------

Status Collector::Impl::CheckEpisode(const Episode& episode) const {
  const auto wrong = [&](const char* what, const auto& found, const auto& expected) {
    return Fail(Code::kInvalidArgument, fmt::format("episode {} of campaign '{}': {} is {}, expected {}", episode.index,
                                                    spec.name, what, found, expected));
  };
  if (episode.campaign != spec.name) return wrong("campaign", episode.campaign, spec.name);
  if (episode.index >= spec.episodes) return wrong("index", episode.index, spec.episodes);
  if (episode.version != Version()) return wrong("version", episode.version, Version());
  if (episode.spec_sha256 != spec_sha256) return wrong("spec", episode.spec_sha256, spec_sha256);
  const std::uint64_t seed = EpisodeSeed(spec, episode.index, episode.attempt);
  if (episode.seed != seed) return wrong("seed", episode.seed, seed);
  const std::string task = TaskOf(spec, episode.index);
  if (episode.task != task) return wrong("task", episode.task, task);
  if (spec.mode == "demonstrate" && !episode.success) return wrong("outcome", episode.outcome, "success");
  return {};
}

std::optional<bus::Verdict> Collector::Impl::Judge(const bus::ReceivedObject& object, Episode& episode) {
  auto decoded = DecodeEpisode(object.bytes);
  const Status fits = decoded ? CheckEpisode(*decoded) : Status(Fail(decoded.error()));
  const std::lock_guard lock(mutex);
  heard[object.manifest.sender] = MonotonicClock::now();
  if (!fits) {
    ++counters.refused;
    Log().warn("refused an episode worker={}: {}", object.manifest.sender, fits.error().message);
    return bus::Verdict{bus::AckKind::kRefused, fits.error().message};
  }
  episode = std::move(*decoded);
  switch (table.Check(episode.index, episode.attempt, object.manifest.token)) {
    case Standing::kCurrent:
      return std::nullopt;
    case Standing::kCommitted:
      ++counters.duplicates;
      return bus::Verdict{bus::AckKind::kDuplicate, ""};
    case Standing::kStale:
      break;
  }
  ++counters.stale_results;
  return bus::Verdict{bus::AckKind::kRefused,
                      fmt::format("index {} was leased again: token {} is old", episode.index, object.manifest.token)};
}

std::optional<bus::Verdict> Collector::Impl::CommitUntilDurable(const Episode& episode) {
  while (true) {
    Status committed = [&] {
      const std::lock_guard lock(sink_mutex);
      return sink->Commit(episode);
    }();
    std::unique_lock lock(mutex);
    if (committed) {
      counters.error.clear();
      return bus::Verdict{bus::AckKind::kDone, ""};
    }
    const Error& error = committed.error();
    if (error.code == Code::kInvalidArgument || error.code == Code::kCorrupt) {
      ++counters.refused;
      return bus::Verdict{bus::AckKind::kRefused, error.message};
    }
    if (counters.error != error.message)
      Log().error("committing waits, nothing is lost, it is tried again: {}", error.message);
    counters.error = error.message;
    if (Stopping()) return std::nullopt;
    // released for the wait, so that leases stay alive meanwhile
    lock.unlock();
    WaitForStop(options.retry_commit);
    if (Stopping()) return std::nullopt;
  }
}

void Collector::Impl::OnEpisode(const bus::ReceivedObject& object) {
  Episode episode;
  std::optional<bus::Verdict> verdict = Judge(object, episode);
  if (!verdict) {
    verdict = CommitUntilDurable(episode);
    // not durable and not at fault: no answer, so that it is sent or made again
    if (!verdict) return;
    const std::lock_guard lock(mutex);
    if (verdict->kind == bus::AckKind::kDone) {
      table.Commit(episode.index);
      commits.push_back(MonotonicClock::now());
      master_dirty = true;
    } else {
      table.HandBack(episode.index);
    }
  }
  if (const Status sent = episodes.Acknowledge(object.manifest, *verdict); !sent)
    Log().warn("cannot acknowledge to worker={}: {}", object.manifest.sender, sent.error().message);
}

void Collector::Impl::WriteMaster() {
  if (!master_dirty) return;
  const Status written = [&] {
    const std::lock_guard lock(sink_mutex);
    return sink->WriteMaster();
  }();
  const std::lock_guard lock(mutex);
  if (written) {
    master_dirty = false;
  } else {
    Log().warn("cannot write the master file, it is tried again: {}", written.error().message);
  }
}

// Until every worker that is there has been told (or has gone), for at most `linger`.
void Collector::Impl::Linger() {
  const Time end = MonotonicClock::now() + options.linger;
  while (MonotonicClock::now() < end && !Stopping()) {
    {
      const std::lock_guard lock(mutex);
      const Time now = MonotonicClock::now();
      const bool waiting = std::any_of(heard.begin(), heard.end(), [&](const auto& item) {
        return now - item.second < kPresence && !dismissed.contains(item.first);
      });
      if (!waiting) return;
    }
    // a late duplicate is still answered
    if (auto object = episodes.Receive(50ms)) OnEpisode(*object);
  }
}

// ---- public ---------------------------------------------------------------------------------------

Collector::Collector(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Collector::Collector(Collector&&) noexcept = default;
Collector& Collector::operator=(Collector&&) noexcept = default;
Collector::~Collector() = default;

Result<Collector> Collector::Open(const bus::Participant& participant, const CampaignSpec& spec, const Path& folder,
                                  const CollectorOptions& options) {
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  ETUDE_ASSIGN_OR_RETURN(auto sink, OpenSink(folder, spec));
  return Open(participant, spec, std::move(sink), options);
}

Result<Collector> Collector::Open(const bus::Participant& participant, const CampaignSpec& spec,
                                  std::unique_ptr<EpisodeSink> sink, const CollectorOptions& options) {
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  ETUDE_RETURN_IF_ERROR(CheckAlone(participant, spec.name));
  ETUDE_ASSIGN_OR_RETURN(const std::uint64_t epoch, NextEpoch(sink->folder()));
  LeaseTable table(
      {spec.episodes, static_cast<std::uint32_t>(spec.max_attempts), options.max_in_flight, options.lease, epoch});
  for (const std::uint64_t index : sink->committed()) table.RestoreCommitted(index);
  const History history = ReadHistory(sink->folder());
  for (const auto& [index, past] : history.indices) table.RestoreFailures(index, past.failures, past.next_attempt);

  const std::string& name = spec.name;
  ETUDE_ASSIGN_OR_RETURN(auto announcements, bus::Writer<bus::CampaignAnnouncement>::Open(participant, name));
  ETUDE_ASSIGN_OR_RETURN(auto leases, bus::Writer<bus::Lease>::Open(participant, name));
  ETUDE_ASSIGN_OR_RETURN(auto statuses, bus::Writer<bus::CampaignStatus>::Open(participant, name));
  ETUDE_ASSIGN_OR_RETURN(auto requests, bus::Reader<bus::WorkRequest>::Open(participant, name));
  ETUDE_ASSIGN_OR_RETURN(auto reports, bus::Reader<bus::AttemptReport>::Open(participant, name));
  ETUDE_ASSIGN_OR_RETURN(auto heartbeats, bus::Reader<bus::WorkerStatus>::Open(participant, name));
  ETUDE_ASSIGN_OR_RETURN(auto episodes, bus::ObjectReceiver::Open(participant, name, "episode"));

  std::unique_ptr<Impl> impl(new Impl{.spec = spec,
                                      .spec_sha256 = SpecHash(spec),
                                      .options = options,
                                      .sink = std::move(sink),
                                      .epoch = epoch,
                                      .announcements = std::move(announcements),
                                      .leases = std::move(leases),
                                      .statuses = std::move(statuses),
                                      .requests = std::move(requests),
                                      .reports = std::move(reports),
                                      .heartbeats = std::move(heartbeats),
                                      .episodes = std::move(episodes),
                                      .table = std::move(table)});
  // before anything is committed, files may still be mended
  if (!impl->sink->committed().empty()) impl->files_sha256 = KnownFiles(impl->sink->folder());
  impl->counters.failures = history.failures;
  impl->failed_attempts = history.total;
  return Collector(std::move(impl));
}

Status Collector::Run() {
  Impl& impl = *impl_;
  impl.started = MonotonicClock::now();
  impl.Announce(impl.Complete());
  Log().info("campaign={} episodes={} committed={} epoch={}", impl.spec.name, impl.spec.episodes,
             impl.table.committed(), impl.epoch);
  std::thread control([&impl] { impl.Control(); });

  Stopwatch since_master;
  while (!impl.Stopping() && !impl.Complete()) {
    if (auto object = impl.episodes.Receive(50ms)) impl.OnEpisode(*object);
    if (since_master.Seconds() * 1000 < static_cast<double>(impl.options.master_every.count())) continue;
    impl.WriteMaster();
    since_master.Restart();
  }
  impl.WriteMaster();
  if (impl.Complete()) {
    impl.Announce(true);
    impl.Linger();
  }
  impl.finished.store(true);
  control.join();
  const CollectorProgress progress = this->progress();
  Log().info("campaign={} committed={}/{} given_up={} attempts={}", impl.spec.name, progress.committed, progress.total,
             progress.given_up, progress.attempts);
  return {};
}

void Collector::Stop() { impl_->stop.store(true); }

CollectorProgress Collector::progress() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->Snapshot();
}

void Collector::ForgetWorker(const std::string& worker) {
  const std::lock_guard lock(impl_->mutex);
  impl_->table.ForgetWorker(worker);
  impl_->heard.erase(worker);
}

}  // namespace etude::campaign
