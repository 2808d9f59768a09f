// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/worker_client.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "services/bus/blob_transfer.h"
#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/campaign/ack_log.h"
#include "services/campaign/heartbeat.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/crash_point.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/service_manager.h"
#include "services/core/stop.h"
#include "services/episode/bounded_json.h"

namespace etude::campaign {
namespace {

using namespace std::chrono_literals;

// Everything that belongs to one campaign, known by its id.
struct Connection {
  std::string id;
  bus::Reader<bus::CampaignAnnouncement> announcements;
  bus::Reader<bus::Lease> leases;
  bus::Writer<bus::WorkRequest> requests;
  bus::Writer<bus::AttemptReport> reports;
  bus::BlobSender sender;
  std::unique_ptr<Heartbeat> heartbeat;

  std::optional<bus::CampaignAnnouncement> announcement;  // the newest
  std::string ready_for;                                  // spec hash that `work` was made for
  CampaignSpec spec;                                      // that it was made for
  WorkFunction work;
  std::string files_sha256;
  Fingerprint fingerprint;
  std::optional<bus::AttemptReport> last_report;  // of the last attempt that failed

  void TakeAnnouncements() {
    for (auto& taken : announcements.Take())
      if (taken.campaign_id == id && (!announcement || taken.epoch >= announcement->epoch))
        announcement = std::move(taken);
  }
  bool complete() const { return announcement && announcement->complete; }
};

Result<std::unique_ptr<Connection>> Connect(const bus::Participant& participant, const bus::Presence& found,
                                            const WorkerOptions& options) {
  const bus::Owner owner{found.name, found.id};
  const std::string partition = owner.partition();
  ETUDE_ASSIGN_OR_RETURN(auto announcements, bus::Reader<bus::CampaignAnnouncement>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto leases, bus::Reader<bus::Lease>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto requests, bus::Writer<bus::WorkRequest>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto reports, bus::Writer<bus::AttemptReport>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto heartbeats, bus::Writer<bus::WorkerStatus>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto sender, bus::BlobSender::Open(participant, owner, "episode", options.name));
  bus::WorkerStatus status;
  status.campaign = found.name;
  status.campaign_id = found.id;
  status.worker = options.name;
  status.host = HostName();
  status.phase = "idle";
  return std::unique_ptr<Connection>(
      new Connection{.id = found.id,
                     .announcements = std::move(announcements),
                     .leases = std::move(leases),
                     .requests = std::move(requests),
                     .reports = std::move(reports),
                     .sender = std::move(sender),
                     .heartbeat = std::make_unique<Heartbeat>(std::move(heartbeats), status, options.heartbeat)});
}

/// What tells `heartbeat` how far an attempt is, and the service manager that it moves.
ProgressFunction ProgressTo(Heartbeat& heartbeat, WatchedLoop& watched) {
  return [&heartbeat, &watched](std::string_view stage, std::uint32_t step) {
    watched.Moved();
    heartbeat.Set([&](bus::WorkerStatus& status) {
      status.phase = "play";
      if (status.stage != stage) status.stage = stage.substr(0, 63);
      status.step = step;
    });
  };
}

Status Refuse(const std::string& campaign, const char* what, std::uint32_t there, const std::string& program,
              std::uint32_t here) {
  return Fail(Code::kUnavailable,
              fmt::format("join campaign '{}': its collector has {} {} (program {}), this worker {} (program {}): use "
                          "programs of the same {}",
                          campaign, what, there, program, here, Version(), what));
}

}  // namespace

struct WorkerClient::Impl {
  const bus::Participant* participant = nullptr;
  WorkerOptions options;
  Selector selector;
  bus::Directory directory;
  std::unique_ptr<Connection> joined;
  std::uint64_t request_id = 0;
  std::uint64_t episodes = 0, failures = 0;
  std::optional<WatchedLoop> watched;  // while Run is at it
  AckLog acknowledged = AckLog::FromEnvironment();
  Stopwatch since_work = {};  // since anybody had work, or took what was made

  Status Join();
  bool Replaced();
  bool Unwanted() const;
  bool CollectorHasGone();
  Status Prepare(const WorkFactory& factory);
  bus::WorkRequest NextRequest();
  Result<bus::Lease> Ask();
  Status Serve(const bus::Lease& lease);
  double HandIn(const bus::Lease& lease, const WorkResult& result);
  void Send(const bus::Lease& lease, const WorkResult& result);
  void Report(const bus::Lease& lease, const std::string& outcome, const std::string& details_json);
  static void TakeUp(const bus::Lease& lease, bus::WorkerStatus& status);
  static void Count(const WorkResult& result, double send_s, bus::WorkerStatus& status);
};

// Waits for the campaign and its announcement; again when another one has taken the place of the one that was joined.
Status WorkerClient::Impl::Join() {
  if (joined && Replaced()) {
    Log().info("campaign={}@{} has gone, another one of its name is there", selector.name, joined->id);
    joined.reset();
  }
  Stopwatch since_word;
  bool said = false;
  while (!StopRequested() && !Unwanted() && !(joined && joined->announcement)) {
    watched->Moved();
    if (!said || since_word.Seconds() > 30) {
      Log().info("waiting for campaign={}: is its collector running on this domain?", selector.text());
      since_word.Restart();
      said = true;
    }
    if (joined) {
      joined->announcements.Wait(1s);
      joined->TakeAnnouncements();
      if (!joined->announcement && Replaced()) joined.reset();
      continue;
    }
    ETUDE_ASSIGN_OR_RETURN(const auto found, directory.Find(bus::PresenceKind::kCampaign, selector, 1s));
    if (!found) continue;
    ETUDE_ASSIGN_OR_RETURN(joined, Connect(*participant, *found, options));
  }
  return {};
}

// True when the collector of the joined campaign is not there and that of another one of the name is.
bool WorkerClient::Impl::Replaced() { return directory.Replaced(bus::PresenceKind::kCampaign, selector, joined->id); }

bool WorkerClient::Impl::Unwanted() const {
  return options.idle_timeout.count() > 0 &&
         1000 * since_work.Seconds() > static_cast<double>(options.idle_timeout.count());
}

bool WorkerClient::Impl::CollectorHasGone() {
  return directory.Matching(bus::PresenceKind::kCampaign, {selector.name, joined->id}).empty();
}

// Makes the work function, again when the spec has changed.
Status WorkerClient::Impl::Prepare(const WorkFactory& factory) {
  const bus::CampaignAnnouncement& announcement = *joined->announcement;
  if (announcement.wire != bus::kWireVersion)
    return Refuse(selector.text(), "wire number", announcement.wire, announcement.version, bus::kWireVersion);
  if (announcement.content != options.content)
    return Refuse(selector.text(), "content number", announcement.content, announcement.version, options.content);
  if (joined->work && joined->ready_for == announcement.spec_sha256) return {};
  const std::string origin = fmt::format("campaign '{}'", selector.text());
  const auto json = ParseBoundedJson(announcement.spec_json);
  if (!json) return Fail(Code::kCorrupt, fmt::format("join {}: the announced spec is not JSON", origin));
  ETUDE_ASSIGN_OR_RETURN(const auto spec, FromJson<CampaignSpec>(*json, origin));
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  if (SpecHash(spec) != announcement.spec_sha256)
    return Fail(Code::kUnavailable, fmt::format("join {}: the announced hash does not fit the spec", origin));
  joined->work = nullptr;  // the old one's context goes first
  const Selector policy{spec.rollout.run, announcement.policy_id};
  ETUDE_ASSIGN_OR_RETURN(joined->work, factory({joined->id, spec, policy.text(), [this] { watched->Moved(); }}));
  joined->files_sha256.clear();
  if (options.files_sha256) {
    ETUDE_ASSIGN_OR_RETURN(joined->files_sha256, options.files_sha256(spec));
  }
  if (options.fingerprint) {
    ETUDE_ASSIGN_OR_RETURN(joined->fingerprint, options.fingerprint(spec));
  }
  joined->spec = spec;
  joined->ready_for = announcement.spec_sha256;
  return {};
}

bus::WorkRequest WorkerClient::Impl::NextRequest() {
  bus::WorkRequest request;
  request.campaign = selector.name;
  request.campaign_id = joined->id;
  request.worker = options.name;
  request.request_id = ++request_id;
  request.version = Version();
  request.content = options.content;
  request.spec_sha256 = joined->ready_for;
  request.files_sha256 = joined->files_sha256;
  if (!joined->fingerprint.empty()) request.fingerprint_json = FingerprintText(joined->fingerprint);
  return request;
}

// Asks until answered; the collector may be away for a while. kWait also when there is something new to look at.
Result<bus::Lease> WorkerClient::Impl::Ask() {
  bus::Lease none;
  // the first answers may be lost while both sides still discover each other
  auto patience = std::min<std::chrono::milliseconds>(100ms, options.ask_again);
  while (!StopRequested()) {
    watched->Moved();
    const bus::WorkRequest request = NextRequest();
    if (const Status asked = joined->requests.Write(request); !asked) Log().debug("request: {}", asked.error().message);
    const auto deadline = MonotonicClock::now() + patience;
    patience = std::min(2 * patience, options.ask_again);
    while (MonotonicClock::now() < deadline && !StopRequested()) {
      if (!joined->leases.Wait(deadline - MonotonicClock::now())) break;
      for (auto& lease : joined->leases.Take()) {
        const bool ours = lease.worker == options.name && lease.campaign_id == joined->id;
        if (ours && lease.request_id == request.request_id) return lease;
      }
    }
    joined->TakeAnnouncements();
    if (joined->complete()) none.kind = bus::LeaseKind::kDone;
    const bool changed = joined->announcement->spec_sha256 != joined->ready_for;
    if (joined->complete() || changed || Unwanted() || Replaced()) break;
  }
  return none;
}

void WorkerClient::Impl::Report(const bus::Lease& lease, const std::string& outcome, const std::string& details_json) {
  bus::AttemptReport report;
  report.campaign = selector.name;
  report.campaign_id = joined->id;
  report.spec_sha256 = joined->ready_for;
  report.worker = options.name;
  report.index = lease.index;
  report.attempt = lease.attempt;
  report.token = lease.token;
  report.outcome = outcome;
  report.details_json = details_json;
  joined->last_report = std::move(report);
  if (const Status sent = joined->reports.Write(*joined->last_report); !sent)
    Log().warn("cannot report an attempt, its lease will come again: {}", sent.error().message);
}

void WorkerClient::Impl::Send(const bus::Lease& lease, const WorkResult& result) {
  joined->heartbeat->SetPhase("send");
  CrashPoint("worker.before_send", lease.index);
  OrderedJson meta{
      {"index", lease.index}, {"attempt", lease.attempt}, {"host", HostName()}, {"timings", TimesJson(result.times)}};
  if (!joined->fingerprint.empty()) meta["fingerprint"] = ShortHash(joined->fingerprint);
  while (true) {
    watched->Moved();
    // the token is unique, so it is the blob's id too: a repeat is recognised
    const auto verdict =
        joined->sender.Send(lease.token, result.episode, lease.token, meta.dump(), options.send_timeout);
    if (verdict) {
      CrashPoint("worker.after_ack", lease.index);
      acknowledged.Note(joined->id, lease, *verdict, result.episode);
      if (verdict->kind == bus::AckKind::kRefused)
        Log().warn("refused index={} attempt={}: {}", lease.index, lease.attempt, verdict->reason);
      else
        ++episodes;
      return;
    }
    if (StopRequested()) return Report(lease, kReleased, "{}");
    Log().warn("not acknowledged yet, sending again index={}: {}", lease.index, verdict.error().message);
    joined->TakeAnnouncements();
    if (joined->complete() || Replaced()) return;
    if (!Unwanted() || !CollectorHasGone()) continue;
    Log().warn("gave up index={}: its collector has gone and nobody took it for {} s", lease.index,
               since_work.Seconds());
    return;
  }
}

// What an attempt adds to a worker's sums.
void WorkerClient::Impl::Count(const WorkResult& result, double send_s, bus::WorkerStatus& status) {
  status.stage.clear();
  status.last_outcome = (result.outcome.empty() ? "success" : result.outcome).substr(0, 127);
  status.plan_s += result.times.plan_s;
  status.step_s += result.times.step_s;
  status.render_s += result.times.render_s;
  status.deflate_s += result.times.deflate_s;
  status.send_s += send_s;
  if (result.outcome == kReleased) return;  // not made to its end: no plan's time
  status.plan_histogram.resize(bus::kPlanBins);
  ++status.plan_histogram[bus::PlanBin(result.times.plan_s)];
}

void WorkerClient::Impl::TakeUp(const bus::Lease& lease, bus::WorkerStatus& status) {
  status.phase = "plan";
  status.stage.clear();
  status.step = 0;
  status.index = lease.index;
  status.attempt = lease.attempt;
  status.token = lease.token;
}

Status WorkerClient::Impl::Serve(const bus::Lease& lease) {
  // this very attempt was reported already: the report was lost, or is on its way
  if (joined->last_report && joined->last_report->token == lease.token) {
    (void)joined->reports.Write(*joined->last_report);
    WaitForStop(20ms);
    return {};
  }
  const auto weights = ParseWeights(lease.sampling_json, joined->spec);
  if (!weights) {
    // none that a collector of this spec would send: what is leased is asked for again
    Log().warn("did not take a lease index={}: {}", lease.index, weights.error().message);
    WaitForStop(200ms);
    return {};
  }
  joined->heartbeat->Set([&](bus::WorkerStatus& status) { TakeUp(lease, status); });
  Stopwatch elapsed;
  auto result = joined->work({lease.index, lease.attempt, *weights, ProgressTo(*joined->heartbeat, *watched)});
  const double seconds = elapsed.Seconds();
  if (result) result->times.wall_s = seconds;
  if (!result) {
    Report(lease, kReleased, "{}");
    return Fail(result.error());
  }
  since_work.Restart();
  const double send_s = HandIn(lease, *result);
  joined->heartbeat->Set([&](bus::WorkerStatus& status) {
    status.phase = "idle";
    status.token = 0;
    Count(*result, send_s, status);
    status.episodes = episodes;
    status.failures = failures;
    status.steps_per_second = static_cast<double>(result->steps) / seconds;
    status.frames_per_second = static_cast<double>(result->frames) / seconds;
  });
  return {};
}

// An episode is sent, a failure reported, and what a stop cut off is handed back. Returns the seconds of the sending.
double WorkerClient::Impl::HandIn(const bus::Lease& lease, const WorkResult& result) {
  if (result.episode.empty()) {
    if (result.outcome != kReleased) ++failures;
    Report(lease, result.outcome, result.details_json);
  } else if (StopRequested()) {
    Report(lease, kReleased, "{}");
  } else {
    const Stopwatch sending;
    Send(lease, result);
    return sending.Seconds();
  }
  return 0;
}

WorkerClient::WorkerClient(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
WorkerClient::WorkerClient(WorkerClient&&) noexcept = default;
WorkerClient& WorkerClient::operator=(WorkerClient&&) noexcept = default;
WorkerClient::~WorkerClient() = default;
const std::string& WorkerClient::name() const { return impl_->options.name; }

Result<WorkerClient> WorkerClient::Open(const bus::Participant& participant, const WorkerOptions& options) {
  WorkerOptions resolved = options;
  ETUDE_ASSIGN_OR_RETURN(auto selector, ParseSelector(resolved.campaign, "--campaign"));
  if (resolved.name.empty()) resolved.name = bus::UniquePeerName();
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  return WorkerClient(
      std::unique_ptr<Impl>(new Impl{&participant, std::move(resolved), std::move(selector), std::move(directory)}));
}

Status WorkerClient::Run(const WorkFactory& factory) {
  Impl& impl = *impl_;
  impl.watched.emplace();
  impl.since_work.Restart();
  while (!StopRequested()) {
    impl.watched->Moved();
    ETUDE_RETURN_IF_ERROR(impl.Join());
    if (StopRequested()) break;
    if (impl.Unwanted()) {
      Log().info("going home: nobody had work for {:.0f} s (--idle-timeout)", impl.since_work.Seconds());
      break;
    }
    impl.joined->TakeAnnouncements();
    ETUDE_RETURN_IF_ERROR(impl.Prepare(factory));
    ETUDE_ASSIGN_OR_RETURN(const bus::Lease lease, impl.Ask());
    switch (lease.kind) {
      case bus::LeaseKind::kDone:
        return {};
      case bus::LeaseKind::kRefused:
        return Fail(Code::kUnavailable, lease.reason);
      case bus::LeaseKind::kWait:
        WaitForStop(200ms);
        break;
      case bus::LeaseKind::kWork:
        // a collector that came back with another spec: what we would make is not what it leased
        if (lease.spec_sha256 != impl.joined->ready_for) break;
        ETUDE_RETURN_IF_ERROR(impl.Serve(lease));
        if (impl.options.once) return {};
        if (!impl.Unwanted()) impl.since_work.Restart();
        break;
    }
  }
  return {};
}

}  // namespace etude::campaign
