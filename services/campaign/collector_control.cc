// SPDX-License-Identifier: Apache-2.0
// The collector's control thread: requests, reports, heartbeats, status.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <thread>

#include "services/campaign/collector_impl.h"
#include "services/campaign/history.h"
#include "services/campaign/worker_client.h"
#include "services/core/command.h"
#include "services/core/file.h"
#include "services/core/log.h"
#include "services/core/printable.h"
#include "services/core/service_manager.h"
#include "services/episode/bounded_json.h"

namespace etude::campaign {

using namespace std::chrono_literals;

void Collector::Impl::Control() {
  Time next_status = MonotonicClock::now();
  WatchedLoop watched;
  while (!finished.load()) {
    watched.Moved();
    // a request is what a worker waits for; a report is always followed by one
    if (!topics.requests.Wait(20ms) && StopRequested()) std::this_thread::sleep_for(5ms);
    TakeMessages();
    topics.leases.Tidy();
    if (MonotonicClock::now() < next_status) continue;
    GiveWayToSuccessor();
    PublishStatus();
    SayUnchecked(false);
    next_status = MonotonicClock::now() + options.status_every;
  }
  TakeMessages();
  PublishStatus();
}

// Looking around at the start cannot see one that is cut off just then.
void Collector::Impl::GiveWayToSuccessor() {
  const auto successor = presence.Successor();
  if (!successor || Stopping()) return;
  const MutexLock lock(mutex);
  ended_by = bus::GivingWay(presence.presence(), *successor);
  stop = true;
}

void Collector::Impl::TakeMessages() {
  // requests are taken first and answered last: a report that was sent before its worker's next request
  // is then always seen before it
  auto asked = topics.requests.Take();
  for (const auto& report : topics.reports.Take()) OnReport(report);
  // heartbeats that queued while this process was suspended count before anything expires
  std::set<std::string> gone;  // since they asked
  for (auto taken = topics.heartbeats.Take(); !taken.empty(); taken = topics.heartbeats.Take())
    for (const auto& status : taken) {
      OnHeartbeat(status);
      if (status.phase == bus::kGonePhase) gone.insert(status.worker);
    }
  if (!gone.empty()) {  // what they asked may have come between the two
    for (auto& request : topics.requests.Take()) asked.push_back(std::move(request));
    for (const auto& report : topics.reports.Take()) OnReport(report);
  }
  for (const Deadly& failed : EndSilent()) Record(failed);
  for (const auto& message : topics.errors.Take()) OnErrors(message);
  bool controlled = false;
  for (const auto& control : topics.controls.Take()) controlled = OnControl(control) || controlled;
  if (answered.exchange(false) || controlled) PublishStatus();  // who asked waits for it
  for (const auto& request : asked)
    if (!gone.contains(request.worker)) OnRequest(request);
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

// A worker whose episodes never fit is no use here, and would be leased the same work for ever.
std::optional<std::string> Collector::Impl::WhySentAway(const std::string& worker) const {
  const MutexLock lock(mutex);
  const auto found = unfit.find(worker);
  if (found == unfit.end() || found->second.in_a_row < options.unfit_budget) return std::nullopt;
  return fmt::format("the last {} episodes of worker {} did not fit campaign '{}'; the last one: {}",
                     found->second.in_a_row, worker, spec.name, found->second.reason);
}

namespace {

// "" of a worker without files of its user's; else hex.
bool IsDigest(const std::string& text) {
  return text.size() <= 64 && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

}  // namespace

// The first worker that asks says which files and libraries count; it may have been the odd one.
std::string Collector::Impl::WhileNothingIsCommitted() const {
  const MutexLock lock(mutex);
  if (table.committed() > 0) return "";
  return "; nothing is committed yet: the collector started again begins with those of the worker that asks first";
}

// Workers that would make other episodes than the rest, or that we would misunderstand.
std::optional<std::string> Collector::Impl::WhyRefused(const bus::WorkRequest& request) {
  const auto other = [&](const char* what, std::uint32_t here, std::uint32_t there) {
    return fmt::format(
        "campaign '{}' is collected with {} {} (program {}), this worker has {} (program {}): use "
        "programs of the same {}",
        spec.name, what, here, Version(), there, request.version, what);
  };
  if (request.wire != bus::kWireVersion) return other("wire number", bus::kWireVersion, request.wire);
  if (!IsPlainName(request.host))
    return fmt::format("worker {} does not name its host: use this program's worker", request.worker);
  if (request.content != options.content) return other("content number", options.content, request.content);
  if (const auto why = WhySentAway(request.worker)) return why;
  if (request.spec_sha256 != spec_sha256) return std::nullopt;  // its files are those of another spec
  if (!IsDigest(request.files_sha256))
    return fmt::format("worker {} names its files by what is no SHA-256: use this program's worker", request.worker);
  if (!files_sha256) {
    files_sha256 = request.files_sha256;
    if (const Status remembered = RememberFiles(sink->folder(), request.files_sha256); !remembered)
      Log().warn("after a restart the first worker's files will count: {}", remembered.error().message);
  }
  if (request.files_sha256 != *files_sha256)
    return fmt::format(
        "campaign '{}' began with other robot or object files than this worker has under the same paths "
        "(SHA-256 {}, here {}): copy them from where it began, or collect into another folder{}",
        spec.name, *files_sha256, request.files_sha256, WhileNothingIsCommitted());
  return WhyUnlike(request);
}

// A host whose episodes would have other bytes. One that does not say what they depend on is an older program's.
std::optional<std::string> Collector::Impl::WhyUnlike(const bus::WorkRequest& request) {
  if (request.fingerprint_json.empty() || spec.determinism == "none") return std::nullopt;
  const auto there = ParseFingerprint(request.fingerprint_json);
  if (!there) return there.error().message;
  if (!fingerprint) {
    fingerprint = *there;
    if (const Status remembered = RememberFingerprint(sink->folder(), *there); !remembered)
      Log().warn("after a restart the first worker's fingerprint will count: {}", remembered.error().message);
  }
  const auto difference = FirstDifference(*there, *fingerprint, spec.determinism);
  if (!difference) return std::nullopt;
  return fmt::format(
      "this host's episodes would have other bytes than those of campaign '{}' ({}): use the same libraries and driver "
      "(`etude worker --fingerprint` prints them), or allow it with determinism: physics or none{}",
      spec.name, *difference, WhileNothingIsCommitted());
}

bus::Lease Collector::Impl::Answer(const bus::WorkRequest& request) {
  bus::Lease lease;
  lease.campaign = spec.name;
  lease.campaign_id = id;
  lease.spec_sha256 = spec_sha256;
  lease.worker = request.worker;
  lease.request_id = request.request_id;
  lease.duration_ns = static_cast<std::uint64_t>(std::chrono::nanoseconds(options.lease).count());
  if (const auto why = WhyRefused(request)) {
    lease.kind = bus::LeaseKind::kRefused;
    lease.reason = *why;
    Log().warn("refused worker={}: {}", request.worker, *why);
    return lease;
  }
  const Assignment assignment = Assign(request);
  lease.kind = assignment.kind == Assignment::Kind::kWork   ? bus::LeaseKind::kWork
               : assignment.kind == Assignment::Kind::kDone ? bus::LeaseKind::kDone
                                                            : bus::LeaseKind::kWait;
  lease.index = assignment.index;
  lease.attempt = assignment.attempt;
  lease.token = assignment.token;
  if (assignment.kind == Assignment::Kind::kWork) lease.sampling_json = WeightsText(WeightsAt(assignment.index));
  return lease;
}

Assignment Collector::Impl::Assign(const bus::WorkRequest& request) {
  const bool journal_is_durable = Reweight();
  const MutexLock lock(mutex);
  heard[request.worker] = MonotonicClock::now();
  hosts[request.worker] = bus::HostOfAddress(request.host);
  // a stopping collector leases nothing new, and does not say that all is done; a worker that is ready for another
  // spec sees ours in the answer and makes itself ready first
  if (Stopping() || request.spec_sha256 != spec_sha256 || !journal_is_durable) return {};
  if (HoldsElsewhere(request)) return {};
  if (const auto again = MakeAgain(request)) return *again;
  if (!table.Holds(request.worker, request.working_on)) {  // who asks again, because the answer was lost, is told again
    if (leasing != Leasing::kOn && !AllDone()) return {};
    // what its host could make again comes first, to who has nothing in hand
    if (request.working_on != 0 && rechecks.WaitsFor(HostOf(request.worker))) return {};
  }
  // others' episodes are being made again: it may be needed for one that comes back
  if (table.complete() && !AllDone()) return {};
  const Assignment assignment = table.Request(request.worker, MonotonicClock::now(), request.working_on);
  if (assignment.kind == Assignment::Kind::kDone && request.working_on == 0) dismissed.insert(request.worker);
  return assignment;
}

// A lease is told again to the host that it went to only: whoever asks in another's name learns nothing. A worker that
// was started again there goes on at once; one that asks after another has taken its name over is a second one, and
// both would make every attempt.
bool Collector::Impl::HoldsElsewhere(const bus::WorkRequest& request) {
  const bool holds = table.Holds(request.worker) || rechecks.Holds(request.worker);
  const std::string host = bus::HostOfAddress(request.host);
  LeasedTo& last = leased_to[request.worker];
  const std::string last_host = bus::HostOfAddress(last.address);
  if (holds && (host != last_host || (request.host == last.before && request.host != last.address))) {
    constexpr std::size_t kMostTold = 1000;
    if (told_apart.size() < kMostTold && told_apart.insert(request.worker).second)
      Log().warn("{} called {}: one of them waits; give each another --name",
                 host == last_host ? fmt::format("two workers of host '{}' are both", host)
                                   : fmt::format("workers of hosts '{}' and '{}' are both", last_host, host),
                 Printable(request.worker));
    return true;
  }
  if (request.host != last.address) last = {.address = request.host, .before = std::move(last.address)};
  return false;
}

// Which program each worker is, once: the commit is logged, not compared.
void Collector::Impl::Greet(const bus::WorkRequest& request) {
  constexpr std::size_t kMostRemembered = 10'000;
  if (greeted.size() >= kMostRemembered) greeted.clear();
  if (!greeted.insert(request.worker).second) return;
  Log().info("worker={} program={} wire={} content={} (here {})", Printable(request.worker), Printable(request.version),
             request.wire, request.content, BuildVersion());
}

void Collector::Impl::OnRequest(const bus::WorkRequest& request) {
  if (request.campaign_id != id) return;
  Greet(request);
  // who names no host is refused where a worker of another wire number listens: in the campaign's partition
  const std::string host = IsPlainName(request.host) ? request.host : "";
  // an answer that is lost is asked for again
  if (const Status written = topics.leases.Write(host, Answer(request)); !written)
    Log().warn("cannot answer worker={}: {}", request.worker, written.error().message);
}

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
    return;
  }
  heard[status.worker] = now;
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
    table.Fail(report.index, LeaseTable::Retry::kSameAttempt);
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
                     fmt::format("roll out '{}': {}; {}: `etude checkpoint show` says what a policy is for", spec.name,
                                 policy_error, kept)};
  else
    ended_by = Error{Code::kUnavailable,
                     fmt::format("roll out '{}': the policy of run '{}' answered nobody for {:.0f} s ({}); {}: start "
                                 "its `etude policy`, then run this again",
                                 spec.name, spec.rollout.run,
                                 std::chrono::duration<double>(now - *policy_away_since).count(), policy_error, kept)};
  stop = true;
}

// True when it is for this campaign and new: its answer is the next status.
bool Collector::Impl::OnControl(const bus::CampaignControl& control) {
  constexpr std::size_t kMostControls = 256;  // that are remembered
  if (control.campaign_id != id || control.control_id.empty()) return false;
  if (control.action == bus::ControlAction::kFilterKey) return OnKeyWish(control);
  const MutexLock lock(mutex);
  if (control.control_id == control_id) return true;
  // one that came before another one, and whose sender has not heard its answer yet
  if (const auto known = answered_controls.find(control.control_id); known != answered_controls.end()) {
    control_id = control.control_id;
    control_refusal = known->second;
    return true;
  }
  if (answered_controls.size() >= kMostControls) answered_controls.clear();
  control_id = control.control_id;
  control_refusal = Follow(control.action);
  answered_controls[control_id] = control_refusal;
  const char* const names[] = {"pause", "drain", "resume", "stop"};
  Log().info("{} asked by {}@{}{}", names[static_cast<int>(control.action)], control.user, control.host,
             control_refusal.empty() ? "" : ": refused: " + control_refusal);
  return true;
}

// Writing a key rewrites the master file, which may take longer than a lease lasts: the thread that does so now and
// then does it, and answers. True when that is said already, or at once why it cannot be.
bool Collector::Impl::OnKeyWish(const bus::CampaignControl& control) {
  {
    const MutexLock lock(mutex);
    if (control.control_id == control_id) return true;
  }
  const std::string refusal = AddWish(KeyWish{control.control_id, control.filter_key, control.episodes});
  if (refusal.empty()) return false;
  Log().info("filter key asked by {}@{}: refused: {}", control.user, control.host, refusal);
  const MutexLock lock(mutex);
  control_id = control.control_id;
  control_refusal = refusal;
  return true;
}

// Why it cannot be taken; "" when it is.
std::string Collector::Impl::AddWish(KeyWish wish) {
  constexpr std::size_t kMostWishes = 16;
  const MutexLock lock(queue_mutex);
  if (std::ranges::find(key_wishes, wish.control_id, &KeyWish::control_id) != key_wishes.end()) return "";
  if (closing) return fmt::format("the collector of '{}' is about to end: ask again when it has", spec.name);
  if (key_wishes.size() >= kMostWishes) return fmt::format("{} filter keys wait to be written: ask later", kMostWishes);
  key_wishes.push_back(std::move(wish));
  over.NotifyAll();
  return "";
}

// Why it cannot be followed; "" when it was.
std::string Collector::Impl::Follow(bus::ControlAction action) {
  if (AllDone()) return fmt::format("campaign '{}' is complete: there is nothing left to lease", spec.name);
  if (Stopping()) return fmt::format("the collector of '{}' is about to end", spec.name);
  switch (action) {
    case bus::ControlAction::kPause:
      leasing = Leasing::kPaused;
      return "";
    case bus::ControlAction::kDrain:
      leasing = Leasing::kDraining;
      return "";
    case bus::ControlAction::kResume:
      if (leasing == Leasing::kOn) return fmt::format("campaign '{}' is not paused", spec.name);
      leasing = Leasing::kOn;
      policy_away_since.reset();  // while nobody asked it, its silence said nothing
      return "";
    case bus::ControlAction::kStop:
      stop = true;
      return "";
    case bus::ControlAction::kFilterKey:
      break;  // OnKeyWish
  }
  return "an action that this collector does not know";
}

std::string Collector::Impl::StateNow() {
  if (leasing == Leasing::kDraining && table.in_flight() + rechecks.in_flight() == 0) leasing = Leasing::kPaused;
  if (AllDone()) return "complete";
  if (Stopping()) return "stopping";
  if (leasing == Leasing::kOn) return "running";
  return leasing == Leasing::kPaused ? "paused" : "draining";
}

CollectorProgress Collector::Impl::Snapshot() {
  CollectorProgress progress = counters;
  const Time now = MonotonicClock::now();
  progress.committed = table.committed();
  progress.total = table.size();
  progress.given_up = table.given_up();
  progress.attempts = table.committed() + failed_attempts;
  progress.lost_leases = table.lost();
  progress.complete = AllDone();
  if (progress.error.empty()) progress.error = journal_error;
  if (progress.error.empty() && policy_away_since) progress.error = "the policy does not answer: " + policy_error;
  progress.elapsed_s = std::chrono::duration<double>(now - started).count();
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
    const MutexLock lock(mutex);
    const Time now = MonotonicClock::now();
    // when all is done, Drain says how long they are waited for
    if (!all_done) std::erase_if(heard, [&](const auto& item) { return now - item.second > 60s; });
    std::erase_if(hosts, [&](const auto& item) ETUDE_REQUIRES(mutex) { return !heard.contains(item.first); });
    // of who is back after a long silence, and goes on with a lease that had expired, it is still asked
    constexpr std::size_t kMostRemembered = 10'000;
    if (leased_to.size() > kMostRemembered)
      std::erase_if(leased_to, [&](const auto& item) ETUDE_REQUIRES(mutex) {
        return !heard.contains(item.first) && !table.Holds(item.first) && !rechecks.Holds(item.first);
      });
    std::erase_if(motions, [&](const auto& item) ETUDE_REQUIRES(mutex) { return !heard.contains(item.first); });
    while (!commits.empty() && now - commits.front() > kRateWindow) commits.pop_front();
    const CollectorProgress progress = Snapshot();
    status.campaign = spec.name;
    status.campaign_id = id;
    status.committed = progress.committed;
    status.total = progress.total;
    status.attempts = progress.attempts;
    status.given_up = progress.given_up;
    status.workers = progress.workers;
    status.episodes_per_minute = progress.episodes_per_minute;
    status.eta_s = progress.eta_s;
    status.failures_json = OrderedJson(progress.failures).dump();
    status.error = progress.error;
    status.state = StateNow();
    status.control_id = control_id;
    status.control_refusal = control_refusal;
    status.rechecked = progress.rechecked;
    status.mismatched = progress.mismatched;
  }
  if (const Status written = topics.statuses.Write(status); !written)
    Log().debug("cannot publish the status: {}", written.error().message);
}

}  // namespace etude::campaign
