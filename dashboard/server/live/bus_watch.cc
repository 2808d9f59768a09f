// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/live/bus_watch.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/bus/directory.h"
#include "services/bus/owner.h"
#include "services/bus/topic.h"
#include "services/core/log.h"

namespace etude::live {
namespace {

using namespace std::chrono_literals;

constexpr auto kForget = 10min;
constexpr auto kWindow = 60s;
constexpr auto kSampleEvery = 10s;
constexpr std::size_t kSamples = 60;
constexpr std::size_t kStrip = 120;
constexpr std::size_t kMostAttempts = 200;
constexpr std::size_t kMostWorkers = 4096;
constexpr std::size_t kMostOwners = 256;
constexpr auto kLook = 250ms;        // messages
constexpr auto kDirectory = 1000ms;  // who is there

char Letter(const std::string& phase) {
  if (phase == "plan") return 'p';
  if (phase == "play") return 'y';
  return phase == "send" ? 's' : 'i';
}

// The readers of one campaign.
struct CampaignReaders {
  bus::Reader<bus::CampaignStatus> status;
  bus::Reader<bus::CampaignAnnouncement> announcement;
  bus::Reader<bus::WorkerStatus> workers;
  bus::Reader<bus::AttemptReport> attempts;

  static Result<CampaignReaders> Open(const bus::Participant& participant, const std::string& partition) {
    ETUDE_ASSIGN_OR_RETURN(auto status, bus::Reader<bus::CampaignStatus>::Open(participant, partition));
    ETUDE_ASSIGN_OR_RETURN(auto announcement, bus::Reader<bus::CampaignAnnouncement>::Open(participant, partition));
    ETUDE_ASSIGN_OR_RETURN(auto workers, bus::Reader<bus::WorkerStatus>::Open(participant, partition));
    ETUDE_ASSIGN_OR_RETURN(auto attempts, bus::Reader<bus::AttemptReport>::Open(participant, partition));
    return CampaignReaders{std::move(status), std::move(announcement), std::move(workers), std::move(attempts)};
  }
};

// Everything that is read.
class Ears {
 public:
  Ears(const bus::Participant& participant, bus::Directory directory)
      : participant_(participant), directory_(std::move(directory)) {}

  void LookAround(LiveModel& model) {
    const auto present = directory_.Live();
    model.Directory(present, MonotonicClock::now());
    for (const auto& presence : present) Follow(presence);
    // who has gone has no more to say
    std::erase_if(campaigns_, [&](const auto& item) { return !model.view().campaigns.contains(item.first); });
    std::erase_if(runs_, [&](const auto& item) { return !model.view().runs.contains(item.first); });
  }

  void Listen(LiveModel& model) {
    const auto now = MonotonicClock::now();
    for (auto& [id, readers] : campaigns_) {
      for (const auto& message : readers.status.Take()) model.On(id, message, now);
      for (const auto& message : readers.announcement.Take()) model.On(id, message, now);
      for (const auto& message : readers.workers.Take()) model.On(id, message, now);
      for (const auto& message : readers.attempts.Take()) model.On(id, message, now, WallSeconds());
    }
    for (auto& [id, reader] : runs_)
      for (const auto& message : reader.Take()) model.On(id, message, now);
  }

 private:
  void Follow(const bus::Presence& presence) {
    if (presence.wire != bus::kWireVersion || campaigns_.size() + runs_.size() >= kMostOwners) return;
    const std::string partition = bus::Owner{presence.name, presence.id}.partition();
    if (presence.kind == bus::PresenceKind::kCampaign && !campaigns_.contains(presence.id)) {
      auto readers = CampaignReaders::Open(participant_, partition);
      if (readers)
        campaigns_.emplace(presence.id, std::move(*readers));
      else
        Log().warn("campaign={}: {}", presence.name, readers.error().message);
    }
    if (presence.kind == bus::PresenceKind::kRun && !runs_.contains(presence.id)) {
      auto reader = bus::Reader<bus::TrainStatus>::Open(participant_, partition);
      if (reader)
        runs_.emplace(presence.id, std::move(*reader));
      else
        Log().warn("run={}: {}", presence.name, reader.error().message);
    }
  }

  const bus::Participant& participant_;
  bus::Directory directory_;
  std::map<std::string, CampaignReaders> campaigns_;
  std::map<std::string, bus::Reader<bus::TrainStatus>> runs_;
};

}  // namespace

std::int64_t AgeMs(TimePoint heard) {
  return std::chrono::duration_cast<std::chrono::milliseconds>(MonotonicClock::now() - heard).count();
}

std::optional<double> LiveWorker::PerMinute() const {
  if (episodes.size() < 2) return std::nullopt;
  const auto seconds = std::chrono::duration<double>(episodes.back().first - episodes.front().first).count();
  if (seconds < 5) return std::nullopt;
  // a worker that was started again counts from 0
  const auto first = episodes.front().second, last = episodes.back().second;
  return last >= first ? 60.0 * static_cast<double>(last - first) / seconds : 0.0;
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
  std::erase_if(view_.runs, forgotten);
}

void LiveModel::On(const std::string& id, const bus::CampaignStatus& status, TimePoint now) {
  auto& campaign = view_.campaigns[id];
  campaign.heard = now;
  if (!campaign.status || status.committed != campaign.committed) {
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
  std::erase_if(campaign.workers, [&](const auto& item) { return now - item.second.heard > kForget; });
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

BusWatch::BusWatch(const bus::Arguments& arguments) : arguments_(arguments) {
  LiveView view;
  view.enabled = true;
  Publish(view);
  thread_ = std::jthread([this](std::stop_token stop) { Run(std::move(stop)); });
}

BusWatch::~BusWatch() = default;

void BusWatch::Publish(const LiveView& view) {
  auto shared = std::make_shared<const LiveView>(view);
  MutexLock lock(mutex_);
  view_ = std::move(shared);
}

std::shared_ptr<const LiveView> BusWatch::View() const {
  MutexLock lock(mutex_);
  return view_;
}

void BusWatch::Run(std::stop_token stop) {
  LiveModel model;
  model.view().enabled = true;
  const auto failed = [&](const Error& error) {
    Log().warn("the bus is not read: {}", error.message);
    model.view().error = error.message;
    Publish(model.view());
  };
  auto participant = arguments_.Open({security::Role::kGateway});
  if (!participant) return failed(participant.error());
  auto directory = bus::Directory::Open(*participant);
  if (!directory) return failed(directory.error());
  Ears ears(*participant, std::move(*directory));
  TimePoint looked{};
  while (!stop.stop_requested()) {
    if (MonotonicClock::now() - looked >= kDirectory) {
      ears.LookAround(model);
      looked = MonotonicClock::now();
    }
    ears.Listen(model);
    Publish(model.view());
    std::this_thread::sleep_for(kLook);
  }
}

}  // namespace etude::live
