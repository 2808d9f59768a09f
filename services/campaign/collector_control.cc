// SPDX-License-Identifier: Apache-2.0
// The collector's control thread: what it is told, and what it says of the campaign.
#include <fmt/format.h>

#include <algorithm>
#include <thread>

#include "services/campaign/collector_impl.h"
#include "services/core/log.h"
#include "services/core/service_manager.h"

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
  ForgiveStandstill();
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
    if (heard.empty()) policy_away_since.reset();  // while nobody asks it, its silence says nothing
    std::erase_if(hosts, [&](const auto& item) ETUDE_REQUIRES(mutex) { return !heard.contains(item.first); });
    // of who is back after a long silence, and goes on with a lease that had expired, it is still asked
    constexpr std::size_t kMostRemembered = 10'000;
    if (leased_to.size() > kMostRemembered)
      std::erase_if(leased_to, [&](const auto& item) ETUDE_REQUIRES(mutex) {
        return !heard.contains(item.first) && !table.Holds(item.first) && !rechecks.Holds(item.first);
      });
    std::erase_if(motions, [&](const auto& item) ETUDE_REQUIRES(mutex) { return !heard.contains(item.first); });
    std::erase_if(idle, [&](const auto& item) ETUDE_REQUIRES(mutex) { return !heard.contains(item.first); });
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
