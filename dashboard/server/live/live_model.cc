// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/live/live_model.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>

#include "services/core/hash.h"

namespace etude::live {
namespace {

using namespace std::chrono_literals;

constexpr auto kForget = 10min;
constexpr auto kWindow = 60s;
constexpr auto kSampleEvery = 10s;
constexpr auto kWorkerSilent = 10s;
constexpr auto kServerForgotten = 10s;  // a policy server speaks every second
constexpr auto kEndedInOrder = 5s;      // less than DDS's lease (10 s), after which a killed one's endpoints go, too
constexpr auto kRateEvery = 4s;
constexpr std::size_t kSamples = 60;
constexpr std::size_t kStrip = 120;
constexpr std::size_t kMostAttempts = 200;
constexpr std::size_t kMostWorkers = 4096;
constexpr std::size_t kMostOwners = 256;
constexpr std::size_t kMostEvents = 500;
constexpr std::size_t kMostNamed = 5;

char Letter(const std::string& phase) {
  if (phase == "plan") return 'p';
  if (phase == "play") return 'y';
  return phase == "send" ? 's' : 'i';
}

// @param names  at least one, all among its workers
bus::ProcessEvent SilenceOf(const LiveCampaign& campaign, const std::vector<std::string>& names, std::uint64_t number) {
  bus::ProcessEvent event;
  event.process = "silence of " + campaign.presence.id;
  event.role = "worker";
  event.host = campaign.workers.at(names.front()).status.host;
  event.number = number;
  event.time_ms = static_cast<std::uint64_t>(WallSeconds() * 1000);
  event.level = "warn";
  event.code = "worker_silent";
  const auto named = std::min(names.size(), kMostNamed);
  event.text = fmt::format("{}: {} silent", campaign.presence.name,
                           fmt::join(names.begin(), names.begin() + static_cast<std::ptrdiff_t>(named), ", "));
  if (names.size() > named) event.text += fmt::format(", and {} more", names.size() - named);
  return event;
}

}  // namespace

std::int64_t AgeMs(TimePoint heard) {
  return std::chrono::duration_cast<std::chrono::milliseconds>(MonotonicClock::now() - heard).count();
}

bool LiveWorker::Silent(TimePoint now) const { return now - heard > kWorkerSilent; }

std::optional<double> LiveWorker::PerMinute(TimePoint now) const {
  if (episodes.size() < 2 || Silent(now)) return std::nullopt;
  const auto seconds = std::chrono::duration<double>(episodes.back().first - episodes.front().first).count();
  if (seconds < 5) return std::nullopt;
  // a worker that was started again counts from 0
  const auto first = episodes.front().second, last = episodes.back().second;
  return last >= first ? 60.0 * static_cast<double>(last - first) / seconds : 0.0;
}

std::optional<double> LiveServer::AnswersPerSecond() const {
  if (answered.size() < 2 || answered.back().second < answered.front().second) return std::nullopt;
  const auto seconds = std::chrono::duration<double>(answered.back().first - answered.front().first).count();
  if (seconds < 1) return std::nullopt;
  return static_cast<double>(answered.back().second - answered.front().second) / seconds;
}

void LiveModel::Directory(const std::vector<bus::Presence>& present, TimePoint now) {
  for (auto& [id, campaign] : view_.campaigns) campaign.present = false;
  for (auto& [id, run] : view_.runs) run.present = false;
  view_.policies.clear();
  for (const auto& presence : present) {
    if (presence.kind == bus::PresenceKind::kPolicy) view_.policies.push_back({presence});
    if (presence.kind == bus::PresenceKind::kCampaign &&
        (view_.campaigns.contains(presence.id) || view_.campaigns.size() < kMostOwners)) {
      auto& campaign = view_.campaigns[presence.id];
      campaign.presence = presence;
      campaign.present = true;
      if (campaign.heard == TimePoint{}) campaign.heard = now;
    }
    if (presence.kind == bus::PresenceKind::kRun &&
        (view_.runs.contains(presence.id) || view_.runs.size() < kMostOwners)) {
      auto& run = view_.runs[presence.id];
      run.presence = presence;
      run.present = true;
      if (run.heard == TimePoint{}) run.heard = now;
    }
  }
  const auto forgotten = [&](const auto& item) { return !item.second.present && now - item.second.heard > kForget; };
  std::erase_if(view_.campaigns, forgotten);
  TellSilences(now);
  std::erase_if(view_.runs, forgotten);
}

// A warning ends when its worker is forgotten; whether anything stopped in the night is asked in the morning. Also
// forgets workers: not one of them may be left to say anything.
void LiveModel::TellSilences(TimePoint now) {
  std::vector<bus::ProcessEvent> events;
  for (auto& [id, campaign] : view_.campaigns) {
    const auto done = [&](const bus::CampaignStatus& status) {
      return status.committed + status.given_up >= status.total;
    };
    const bool finished = campaign.complete || (campaign.status && done(*campaign.status));
    std::vector<std::string> names;
    for (auto& [name, worker] : campaign.workers) {
      if (finished || worker.silence_told || !worker.Silent(now)) continue;
      worker.silence_told = true;
      names.push_back(name);
    }
    // after the event, which is made of the workers: one may be silent and forgotten at once
    if (!names.empty()) events.push_back(SilenceOf(campaign, names, ++silences_));
    std::erase_if(campaign.workers, [&](const auto& item) { return now - item.second.heard > kForget; });
  }
  On(std::move(events));
}

void LiveModel::On(const std::string& id, const bus::CampaignStatus& status, TimePoint now) {
  auto& campaign = view_.campaigns[id];
  campaign.heard = now;
  const bool goes_on = campaign.status && campaign.status->state != status.state;  // and its time begins anew
  if (!campaign.status || status.committed != campaign.committed || goes_on) {
    campaign.committed = status.committed;
    campaign.changed = now;
  }
  campaign.status = status;
  if (!campaign.per_minute.empty() && now - campaign.sampled < kSampleEvery) return;
  campaign.sampled = now;
  campaign.per_minute.push_back(status.episodes_per_minute);
  if (campaign.per_minute.size() > kSamples) campaign.per_minute.pop_front();
}

void LiveModel::On(const std::string& id, const bus::CampaignAnnouncement& announcement, TimePoint) {
  auto& campaign = view_.campaigns[id];
  campaign.spec_json = announcement.spec_json;
  campaign.complete = announcement.complete;
}

void LiveModel::On(const std::string& id, const bus::WorkerStatus& status, TimePoint now) {
  auto& campaign = view_.campaigns[id];
  // one that went home is neither silent nor a slot
  if (status.phase == bus::kGonePhase) {
    campaign.workers.erase(status.worker);
    return;
  }
  if (!campaign.workers.contains(status.worker) && campaign.workers.size() >= kMostWorkers) return;
  auto& worker = campaign.workers[status.worker];
  if (worker.heard != TimePoint{}) {
    if (status.episodes > worker.status.episodes) worker.last = "success";
    // silence is a dot for each half second that is missing
    for (auto gap = now - worker.heard - 1s; gap > 0s && worker.strip.size() < 2 * kStrip; gap -= 500ms)
      worker.strip += '.';
  }
  worker.strip += Letter(status.phase);
  if (worker.strip.size() > kStrip) worker.strip.erase(0, worker.strip.size() - kStrip);
  worker.episodes.emplace_back(now, status.episodes);
  while (worker.episodes.size() > 2 && now - worker.episodes.front().first > kWindow) worker.episodes.pop_front();
  worker.status = status;
  worker.heard = now;
  worker.silence_told = false;
}

void LiveModel::On(const std::string& id, const bus::AttemptReport& report, TimePoint, double wall) {
  auto& campaign = view_.campaigns[id];
  if (const auto worker = campaign.workers.find(report.worker); worker != campaign.workers.end())
    worker->second.last = report.outcome;
  campaign.attempts.push_front({report, wall});
  if (campaign.attempts.size() > kMostAttempts) campaign.attempts.pop_back();
}

void LiveModel::On(const std::string& id, const bus::TrainStatus& status, TimePoint now) {
  auto& run = view_.runs[id];
  run.status = status;
  run.heard = now;
}

void LiveModel::On(const std::string& id, const bus::WorkRequest& request) {
  if (request.campaign_id != id || request.worker.empty()) return;
  if (!view_.prints.contains(request.worker) && view_.prints.size() >= kMostWorkers) view_.prints.clear();
  const std::string work = fmt::format("{} {} {}", request.content, request.spec_sha256, request.files_sha256);
  view_.prints[request.worker] = {
      .work = Sha256Hex(work).substr(0, 8),
      .host = request.fingerprint_json.empty() ? "" : Sha256Hex(request.fingerprint_json).substr(0, 12)};
}

void LiveModel::On(const bus::PolicyStatus& status, TimePoint now) {
  std::erase_if(view_.servers, [&](const auto& item) { return now - item.second.heard > kServerForgotten; });
  if (!view_.servers.contains(status.server) && view_.servers.size() >= kMostOwners) return;
  auto& server = view_.servers[status.server];
  // it does not say when: a refusal from before it was heard first counts from then
  const bool again = status.refused != server.status.refused || status.last_refusal != server.status.last_refusal;
  if (again) server.refused = now;
  server.status = status;
  server.heard = now;
  server.answered.emplace_back(now, status.answered);
  while (server.answered.size() > 2 && now - server.answered.front().first > kServerForgotten)
    server.answered.pop_front();
}

void LiveModel::On(const bus::ProcessStatus& status, TimePoint now) {
  if (!view_.processes.contains(status.process) && view_.processes.size() >= kMostWorkers) return;
  view_.processes[status.process] = {status, now};
}

void LiveModel::On(std::vector<bus::ProcessEvent> events) {
  if (events.empty()) return;
  const auto now_ms = static_cast<std::uint64_t>(WallSeconds() * 1000);
  auto all = *view_.events;
  for (auto& event : events) {
    // the last ones of each process come again for whoever is new to it
    const bool known = std::ranges::any_of(all, [&](const LiveEvent& item) {
      return item.event.process == event.process && item.event.number == event.number;
    });
    if (known) continue;
    const auto order_ms = std::min(event.time_ms, now_ms);
    all.push_front({std::move(event), order_ms});
  }
  std::ranges::stable_sort(all, std::greater<>(), &LiveEvent::order_ms);
  if (all.size() > kMostEvents) all.resize(kMostEvents);
  view_.events = std::make_shared<const std::deque<LiveEvent>>(std::move(all));
}

void LiveModel::Topics(std::vector<bus::PeerEndpoint> endpoints, const std::string& own, TimePoint now) {
  view_.endpoints = std::make_shared<const std::vector<bus::PeerEndpoint>>(std::move(endpoints));
  view_.participant = own;
  std::set<std::string> there;
  for (const auto& endpoint : *view_.endpoints) there.insert(endpoint.participant);
  std::erase_if(view_.processes, [&](const auto& item) {
    const auto silent = now - item.second.at;
    const auto& participant = item.second.message.participant;
    return silent > kWindow || (!participant.empty() && !there.contains(participant) && silent < kEndedInOrder);
  });
  std::erase_if(view_.servers, [&](const auto& item) { return now - item.second.heard > kServerForgotten; });
  if (rated_ != TimePoint{} && now - rated_ < kRateEvery) return;
  if (rated_ != TimePoint{}) view_.rates = rates_.End(view_.processes);
  rates_.Begin(view_.processes);
  rated_ = now;
}

}  // namespace etude::live
