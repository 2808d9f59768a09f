// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/worker_client.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <optional>
#include <thread>
#include <utility>

#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/campaign/ack_log.h"
#include "services/campaign/known_collectors.h"
#include "services/campaign/lease_table.h"
#include "services/campaign/shard_choice.h"
#include "services/campaign/worker_connection.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/crash_point.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/service_manager.h"
#include "services/core/stop.h"
#include "services/episode/bounded_json.h"
#include "services/spec/attempt_outcome.h"
#include "services/spec/task_files.h"
#include "services/spec/task_name.h"

namespace etude::campaign {
namespace {

using namespace std::chrono_literals;

constexpr double kSayAgain_s = 30;  // what is waited for

// What a worker has made itself ready for. It outlives the way from one shard to the next: they have one spec.
struct Readiness {
  std::string spec_sha256;  // that `work` was made for
  std::string spec_json;    // as announced: keys that are no part of the hash may change
  std::string policy_id;    // that `work` asks: an evaluation that goes on has a policy server with another one
  CampaignSpec spec;
  WorkFunction work;
  std::string files_sha256;
  Fingerprint fingerprint;

  bool IsFor(const bus::CampaignAnnouncement& announced) const {
    return spec_sha256 == announced.spec_sha256 && policy_id == announced.policy_id;
  }
};

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
  KnownCollectors collectors;                     // of the campaign
  ShardChoice choice;                             // among them
  std::unique_ptr<WorkerConnection> joined = {};  // with one of them
  Readiness ready = {};
  bus::WorkerStatus telemetry = {};  // what was counted at collectors that were left
  std::uint64_t request_id = 0;
  std::uint64_t episodes = 0, failures = 0;
  std::optional<WatchedLoop> watched = std::nullopt;  // while Run is at it
  AckLog acknowledged = AckLog::FromEnvironment();
  Stopwatch since_work = {};  // since anybody had work, or took what was made
  std::string unclear = {};   // why it is not known which campaign is meant

  const Selector& selector() const { return collectors.selector(); }
  Status Join();
  Status JoinNext();
  void Leave();
  void LeaveIdleShard();
  void LeaveNowAndThen();
  bool Replaced() { return collectors.Replaced(joined->id); }
  bool Unwanted() const;
  Status Prepare(const WorkFactory& factory);
  bus::WorkRequest NextRequest();
  Result<bus::Lease> Ask();
  ProgressFunction ProgressOf(const bus::Lease& lease);
  void LookAhead(const bus::Lease& lease);
  void HandBackAhead();
  Status Work(const WorkFactory& factory);
  Status CheckFiles() const;
  Status Serve(const bus::Lease& lease);
  double HandIn(const bus::Lease& lease, const WorkResult& result);
  void Send(const bus::Lease& lease, const WorkResult& result);
  bus::AttemptReport ReportOf(const bus::Lease& lease, const std::string& outcome) const;
  void Report(const bus::Lease& lease, const std::string& outcome, const std::string& details_json);
  static void TakeUp(const bus::Lease& lease, bus::WorkerStatus& status);
  static void Count(const WorkResult& result, double send_s, bus::WorkerStatus& status);
};

// Waits for the campaign and the announcement of a collector of it that is not complete; again when that one has gone
// and another one is there.
Status WorkerClient::Impl::Join() {
  if (joined && Replaced()) Leave();
  Stopwatch since_word;
  bool said = false;
  while (!StopRequested() && !Unwanted() && !collectors.Complete() && !(joined && joined->collector->announcement)) {
    watched->Moved();
    if ((!said && collectors.empty()) || since_word.Seconds() > kSayAgain_s) {
      Log().info("waiting for campaign={}: is its collector running on this domain?", selector().text());
      since_word.Restart();
      said = true;
    }
    if (!joined) {
      ETUDE_RETURN_IF_ERROR(JoinNext());
      continue;
    }
    joined->collector->announcements.Wait(1s);
    joined->collector->TakeAnnouncements();
    if (!joined->collector->announcement && Replaced()) Leave();
  }
  return {};
}

Status WorkerClient::Impl::JoinNext() {
  const auto another_campaign = collectors.LookAround();
  // a name that means two campaigns, for as long as it does: a service is not started again after an error of usage
  if (!another_campaign && another_campaign.error().code == Code::kInvalidArgument && ServiceManager::IsThere()) {
    if (std::exchange(unclear, another_campaign.error().message) != another_campaign.error().message)
      Log().warn("{}; waiting until it is clear", another_campaign.error().message);
    WaitForStop(1s);
    return {};
  }
  if (!another_campaign) return Fail(another_campaign.error());
  if (*another_campaign) {
    choice.GoAnywhere();
    ready = {};
  }
  const auto shard = choice.Next(collectors.OpenShards());
  if (!shard) {
    WaitForStop(100ms);  // what was there is complete, or has gone: it may come again
    return {};
  }
  const auto next = collectors.At(*shard);
  if (next->presence.shards > 1)
    Log().info("campaign={} goes to {} ({})", next->presence.name, bus::ShardText(next->presence), next->presence.id);
  ETUDE_ASSIGN_OR_RETURN(joined, WorkerConnection::Open(*participant, next, options, telemetry));
  choice.Joined(*shard);
  return {};
}

// What was counted goes along to the next one; what was leased and not begun is anybody's again.
void WorkerClient::Impl::Leave() {
  if (!joined) return;
  HandBackAhead();
  joined->heartbeat->Set([&](bus::WorkerStatus& status) { telemetry = status; });
  telemetry.token = 0;
  telemetry.stage.clear();
  joined.reset();
}

// A shard that has nothing to lease (the last of its episodes are being made, or it is paused) is no reason to wait
// where another one may have something; less and less often where none has.
void WorkerClient::Impl::LeaveIdleShard() {
  if (joined->collector->presence.shards < 2 || !choice.IsImpatient(joined->since_lease.Seconds())) return;
  if (const Status learned = collectors.Learn(); !learned) Log().debug("look for shards: {}", learned.error().message);
  if (!collectors.Knows(*joined->collector)) return Leave();
  const auto next = choice.Next(collectors.OpenShards());
  if (!next || *next == joined->collector->presence.shard) return;
  choice.WaitLonger();
  Leave();
}

// What a worker has at hand is handed in.
void WorkerClient::Impl::LeaveNowAndThen() {
  if (joined->collector->presence.shards < 2 || !choice.HasStayed(joined->since_joined.Seconds())) return;
  choice.GoAnywhere();
  Leave();
}

bool WorkerClient::Impl::Unwanted() const {
  return options.idle_timeout.count() > 0 &&
         1000 * since_work.Seconds() > static_cast<double>(options.idle_timeout.count());
}

// Makes the work function, again when the spec has changed.
Status WorkerClient::Impl::Prepare(const WorkFactory& factory) {
  const bus::CampaignAnnouncement& announcement = *joined->collector->announcement;
  if (announcement.wire != bus::kWireVersion)
    return Refuse(selector().text(), "wire number", announcement.wire, announcement.version, bus::kWireVersion);
  if (announcement.content != options.content)
    return Refuse(selector().text(), "content number", announcement.content, announcement.version, options.content);
  const bool same_work = ready.work && ready.IsFor(announcement);
  if (same_work && ready.spec_json == announcement.spec_json) return {};
  ForgetTaskFiles();  // those of this campaign may say something else than those of the last one
  const std::string origin = fmt::format("campaign '{}'", selector().text());
  const auto json = ParseBoundedJson(announcement.spec_json);
  if (!json) return Fail(Code::kCorrupt, fmt::format("join {}: the announced spec is not JSON", origin));
  ETUDE_ASSIGN_OR_RETURN(const auto spec, FromJson<CampaignSpec>(*json, origin));
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  if (SpecHash(spec) != announcement.spec_sha256)
    return Fail(Code::kUnavailable, fmt::format("join {}: {}{}", origin, WhyHashDiffers(spec),
                                                TaskFilesOf(spec).empty() ? "" : "; copy the collector's here"));
  ready.spec_json = announcement.spec_json;
  // of what is no part of the hash these two are for who makes episodes
  if (same_work && spec.stall_timeout_s == ready.spec.stall_timeout_s && spec.device == ready.spec.device) {
    ready.spec = spec;
    return {};
  }
  ready.work = nullptr;  // the old one's context goes first
  // what is said of files and libraries is said before anything is made of them
  ready.files_sha256.clear();
  if (options.files_sha256) {
    ETUDE_ASSIGN_OR_RETURN(ready.files_sha256, options.files_sha256(spec));
  }
  if (options.fingerprint) {
    ETUDE_ASSIGN_OR_RETURN(ready.fingerprint, options.fingerprint(spec));
  }
  const Selector policy{spec.rollout.run, announcement.policy_id};
  ETUDE_ASSIGN_OR_RETURN(ready.work, factory({joined->id, spec, policy.text(), announcement.spec_sha256,
                                              [this] { watched->Moved(); }, ready.fingerprint}));
  ready.spec = spec;
  ready.spec_sha256 = announcement.spec_sha256;
  ready.policy_id = announcement.policy_id;
  since_work.Restart();  // to make itself ready was no waiting
  return {};
}

bus::WorkRequest WorkerClient::Impl::NextRequest() {
  bus::WorkRequest request;
  request.campaign = selector().name;
  request.campaign_id = joined->id;
  request.worker = options.name;
  request.host = participant->address();
  request.request_id = ++request_id;
  request.version = BuildVersion();
  request.content = options.content;
  request.spec_sha256 = ready.spec_sha256;
  request.files_sha256 = ready.files_sha256;
  if (!ready.fingerprint.empty()) request.fingerprint_json = FingerprintText(ready.fingerprint);
  return request;
}

// Asks once for what comes next, when the attempt has begun to move, and takes the answer when it is there: the attempt
// does not wait for it. An answer that was lost, or comes too late, is told again when the worker has nothing to do.
void WorkerClient::Impl::LookAhead(const bus::Lease& lease) {
  if (!options.prefetch || options.once || joined->ahead) return;
  if (joined->asked != 0) return joined->TakeAnswerAhead();
  bus::WorkRequest request = NextRequest();
  request.working_on = MarkOf(lease.token);
  joined->Ask(request);
}

// What was leased and not begun is somebody else's, now. The answer may be on its way still, also to whom a stop cut
// off while it asked: waiting for it for a moment costs less than the lease, which would have to run out.
void WorkerClient::Impl::HandBackAhead() {
  constexpr double kMoment_s = 0.3;
  if (!joined) return;
  joined->TakeAnswerAhead();
  for (const Stopwatch waited; joined->asked != 0 && !joined->answered && waited.Seconds() < kMoment_s;) {
    std::this_thread::sleep_for(5ms);
    joined->TakeAnswerAhead();
  }
  joined->asked = 0;
  const auto lease = std::exchange(joined->ahead, std::nullopt);
  if (!lease) return;
  if (const Status sent = joined->reports.Write(ReportOf(*lease, kReleased)); !sent)
    Log().debug("cannot hand a lease back, it runs out by itself: {}", sent.error().message);
}

// Asks until answered; the collector may be away for a while. kWait also when there is something new to look at.
Result<bus::Lease> WorkerClient::Impl::Ask() {
  bus::Lease none;
  // the first answers may be lost while both sides still discover each other
  auto patience = std::min<std::chrono::milliseconds>(100ms, options.ask_again);
  Stopwatch unheard;  // since it was said last
  while (!StopRequested()) {
    watched->Moved();
    const bus::WorkRequest request = NextRequest();
    joined->Ask(request);
    const auto deadline = MonotonicClock::now() + patience;
    patience = std::min(2 * patience, options.ask_again);
    while (MonotonicClock::now() < deadline && !StopRequested()) {
      if (!joined->leases.Wait(deadline - MonotonicClock::now())) break;
      for (auto& lease : joined->leases.Take()) {
        if (!joined->IsAnswer(lease, request.request_id)) continue;
        joined->asked = 0;
        return lease;
      }
    }
    if (unheard.Seconds() > kSayAgain_s) {
      unheard.Restart();
      Log().warn(
          "no answer from the collector of campaign {}@{}: waiting for it; is it running, and can it be reached?",
          selector().name, joined->id);
    }
    joined->collector->TakeAnnouncements();
    const bool complete = joined->collector->complete();
    if (complete) none.kind = bus::LeaseKind::kDone;
    if (complete || !ready.IsFor(*joined->collector->announcement) || Unwanted() || Replaced()) break;
  }
  return none;
}

bus::AttemptReport WorkerClient::Impl::ReportOf(const bus::Lease& lease, const std::string& outcome) const {
  bus::AttemptReport report;
  report.campaign = selector().name;
  report.campaign_id = joined->id;
  report.spec_sha256 = ready.spec_sha256;
  report.worker = options.name;
  report.index = lease.index;
  report.attempt = lease.attempt;
  report.token = lease.token;
  report.outcome = outcome;
  report.details_json = "{}";
  return report;
}

void WorkerClient::Impl::Report(const bus::Lease& lease, const std::string& outcome, const std::string& details_json) {
  joined->last_report = ReportOf(lease, outcome);
  joined->last_report->details_json = details_json;
  if (const Status sent = joined->reports.Write(*joined->last_report); !sent)
    Log().warn("cannot report an attempt, its lease will come again: {}", sent.error().message);
}

void WorkerClient::Impl::Send(const bus::Lease& lease, const WorkResult& result) {
  joined->heartbeat->SetPhase("send");
  CrashPoint("worker.before_send", lease.index);
  OrderedJson meta{
      {"index", lease.index}, {"attempt", lease.attempt}, {"host", HostName()}, {"timings", TimesJson(result.times)}};
  if (!ready.fingerprint.empty()) meta["fingerprint"] = ShortHash(ready.fingerprint);
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
    joined->collector->TakeAnnouncements();
    if (joined->collector->complete() || Replaced()) return;
    if (!Unwanted() || !collectors.HasGone(joined->id)) continue;
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
  status.token = MarkOf(lease.token);
}

// @param lease  must live as long as the attempt
ProgressFunction WorkerClient::Impl::ProgressOf(const bus::Lease& lease) {
  return [this, &lease, tell = ProgressTo(*joined->heartbeat, *watched)](std::string_view stage, std::uint32_t step) {
    tell(stage, step);
    LookAhead(lease);
  };
}

// A robot or an object that is edited while the campaign runs would be in some of its episodes and not in others.
Status WorkerClient::Impl::CheckFiles() const {
  if (!options.files_sha256) return {};
  ETUDE_ASSIGN_OR_RETURN(const std::string now, options.files_sha256(ready.spec));
  if (now == ready.files_sha256) return {};
  return Fail(Code::kUnavailable,
              fmt::format("go on with campaign '{}@{}': the files of its robots or objects have changed since this "
                          "worker joined it; put back what was there, or collect another campaign",
                          selector().name, joined->id));
}

Status WorkerClient::Impl::Serve(const bus::Lease& lease) {
  // this very attempt was reported already: the report was lost, or is on its way
  if (joined->last_report && joined->last_report->token == lease.token) {
    (void)joined->reports.Write(*joined->last_report);
    WaitForStop(20ms);
    return {};
  }
  const auto weights = ParseWeights(lease.sampling_json, ready.spec);
  if (!weights) {
    // none that a collector of this spec would send: what is leased is asked for again
    Log().warn("did not take a lease index={}: {}", lease.index, weights.error().message);
    WaitForStop(200ms);
    return {};
  }
  joined->heartbeat->Set([&](bus::WorkerStatus& status) { TakeUp(lease, status); });
  Stopwatch elapsed;
  auto result = ready.work({lease.index, lease.attempt, *weights, ProgressOf(lease)});
  const double seconds = elapsed.Seconds();
  if (result) result->times.wall_s = seconds;
  const Status same = result ? CheckFiles() : Status(Fail(result.error()));
  if (!same) {
    Report(lease, kReleased, "{}");
    return same;
  }
  since_work.Restart();
  // its child is lost, or it is to stop: who has one gets what would have come next
  if (result->outcome == kReleased) HandBackAhead();
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
  ETUDE_ASSIGN_OR_RETURN(const auto selector, ParseSelector(resolved.campaign, "--campaign"));
  if (resolved.name.empty()) resolved.name = bus::UniquePeerName();
  constexpr std::size_t kLongest = 128;  // that messages carry (proto/campaign.idl)
  if (resolved.name.size() > kLongest)
    return Fail(Code::kInvalidArgument, fmt::format("--name '{}': {} characters, at most {} can be said on the bus",
                                                    resolved.name, resolved.name.size(), kLongest));
  ETUDE_ASSIGN_OR_RETURN(auto collectors, KnownCollectors::Open(participant, selector));
  ShardChoice choice(resolved.name, resolved.stay);
  return WorkerClient(std::unique_ptr<Impl>(new Impl{.participant = &participant,
                                                     .options = std::move(resolved),
                                                     .collectors = std::move(collectors),
                                                     .choice = std::move(choice)}));
}

Status WorkerClient::Impl::Work(const WorkFactory& factory) {
  while (!StopRequested()) {
    watched->Moved();
    ETUDE_RETURN_IF_ERROR(Join());
    if (StopRequested()) break;
    if (Unwanted()) {
      Log().info("going home: nobody had work for {:.0f} s (--idle-timeout)", since_work.Seconds());
      break;
    }
    if (collectors.Complete()) return {};
    joined->collector->TakeAnnouncements();
    ETUDE_RETURN_IF_ERROR(Prepare(factory));
    const auto ahead = joined->TakeAhead(ready.spec_sha256);
    ETUDE_ASSIGN_OR_RETURN(const bus::Lease lease, ahead ? Result<bus::Lease>(*ahead) : Ask());
    switch (lease.kind) {
      case bus::LeaseKind::kDone:
        joined->collector->done_in = joined->collector->announcement->epoch;
        Leave();
        ETUDE_RETURN_IF_ERROR(collectors.Learn());
        break;
      case bus::LeaseKind::kRefused:
        return Fail(Code::kUnavailable, lease.reason);
      case bus::LeaseKind::kWait:
        WaitForStop(200ms);
        LeaveIdleShard();
        break;
      case bus::LeaseKind::kWork:
        // a collector that came back with another spec: what we would make is not what it leased
        if (lease.spec_sha256 != ready.spec_sha256) break;
        joined->collector->TakeAnnouncements();  // or whose policy server is another one
        if (joined->collector->announcement->policy_id != ready.policy_id) break;
        ETUDE_RETURN_IF_ERROR(Serve(lease));
        joined->since_lease.Restart();
        choice.FoundWork();
        LeaveNowAndThen();
        if (options.once) return {};
        if (!Unwanted()) since_work.Restart();
        break;
    }
  }
  return {};
}

Status WorkerClient::Run(const WorkFactory& factory) {
  impl_->watched.emplace();
  impl_->since_work.Restart();
  Status done = impl_->Work(factory);
  impl_->HandBackAhead();
  return done;
}

}  // namespace etude::campaign
