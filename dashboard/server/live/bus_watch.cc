// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/live/bus_watch.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <utility>

#include "dashboard/server/live/sample_tap.h"
#include "services/bus/access.h"
#include "services/bus/directory.h"
#include "services/bus/owner.h"
#include "services/bus/process_reporter.h"
#include "services/bus/topic.h"
#include "services/core/log.h"

namespace etude::live {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t kMostWatched = 256;
constexpr std::size_t kMostRefused = 1000;
constexpr std::size_t kMostWishes = 16;
constexpr auto kWishStands = 5s;
constexpr auto kLook = 250ms;        // messages
constexpr auto kDirectory = 1000ms;  // who is there
constexpr auto kTryAgain = 3s;       // to join the bus

// The readers of one campaign.
struct CampaignReaders {
  bus::Reader<bus::CampaignStatus> status;
  bus::Reader<bus::CampaignAnnouncement> announcement;
  bus::Reader<bus::WorkerStatus> workers;
  bus::Reader<bus::AttemptReport> attempts;
  bus::Reader<bus::WorkRequest> requests;

  static Result<CampaignReaders> Open(const bus::Participant& participant, const std::string& partition) {
    ETUDE_ASSIGN_OR_RETURN(auto status, bus::Reader<bus::CampaignStatus>::Open(participant, partition));
    ETUDE_ASSIGN_OR_RETURN(auto announcement, bus::Reader<bus::CampaignAnnouncement>::Open(participant, partition));
    ETUDE_ASSIGN_OR_RETURN(auto workers, bus::Reader<bus::WorkerStatus>::Open(participant, partition));
    ETUDE_ASSIGN_OR_RETURN(auto attempts, bus::Reader<bus::AttemptReport>::Open(participant, partition));
    ETUDE_ASSIGN_OR_RETURN(auto requests, bus::Reader<bus::WorkRequest>::Open(participant, partition));
    return CampaignReaders{std::move(status), std::move(announcement), std::move(workers), std::move(attempts),
                           std::move(requests)};
  }
};

// The readers of one run.
struct RunReaders {
  bus::Reader<bus::TrainStatus> training;
  bus::Reader<bus::PolicyStatus> servers;

  static Result<RunReaders> Open(const bus::Participant& participant, const std::string& partition) {
    ETUDE_ASSIGN_OR_RETURN(auto training, bus::Reader<bus::TrainStatus>::Open(participant, partition));
    ETUDE_ASSIGN_OR_RETURN(auto servers, bus::Reader<bus::PolicyStatus>::Open(participant, partition));
    return RunReaders{std::move(training), std::move(servers)};
  }
};

// The readers of what every process says.
struct ProcessReaders {
  bus::Reader<bus::ProcessStatus> statuses;
  bus::Reader<bus::ProcessEvent> events;

  static Result<ProcessReaders> Open(const bus::Participant& participant) {
    ETUDE_ASSIGN_OR_RETURN(auto statuses, bus::Reader<bus::ProcessStatus>::Open(participant, bus::kDirectoryPartition));
    ETUDE_ASSIGN_OR_RETURN(auto events, bus::Reader<bus::ProcessEvent>::Open(participant, bus::kDirectoryPartition));
    return ProcessReaders{std::move(statuses), std::move(events)};
  }
};

// Everything that is read.
class Ears {
 public:
  static Result<Ears> Open(const bus::Participant& participant) {
    ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
    ETUDE_ASSIGN_OR_RETURN(auto processes, ProcessReaders::Open(participant));
    return Ears(participant, std::move(directory), std::move(processes));
  }

  void LookAround(LiveModel& model) {
    const auto present = directory_.Live();
    model.Directory(present, MonotonicClock::now());
    for (const auto& presence : present) Follow(presence);
    // who has gone has no more to say
    std::erase_if(campaigns_, [&](const auto& item) { return !model.view().campaigns.contains(item.first); });
    const auto serves = [&](const std::string& id) {
      return std::ranges::any_of(model.view().policies, [&](const auto& policy) { return policy.presence.id == id; });
    };
    std::erase_if(runs_,
                  [&](const auto& item) { return !model.view().runs.contains(item.first) && !serves(item.first); });
    if (auto endpoints = bus::Endpoints(*participant_))
      model.Topics(std::move(*endpoints), bus::ParticipantId(*participant_), MonotonicClock::now());
  }

  void Listen(LiveModel& model) {
    const auto now = MonotonicClock::now();
    for (auto& [id, readers] : campaigns_) {
      for (const auto& message : readers.status.Take()) model.On(id, message, now);
      for (const auto& message : readers.announcement.Take()) model.On(id, message, now);
      for (const auto& message : readers.workers.Take()) model.On(id, message, now);
      for (const auto& message : readers.attempts.Take()) model.On(id, message, now, WallSeconds());
      for (const auto& message : readers.requests.Take()) model.On(id, message);
    }
    for (auto& [id, readers] : runs_) {
      for (const auto& message : readers.training.Take()) model.On(id, message, now);
      for (const auto& message : readers.servers.Take())
        if (message.run_id == id) model.On(message, now);
    }
    for (const auto& message : processes_.statuses.Take()) model.On(message, now);
    model.On(processes_.events.Take());
  }

 private:
  Ears(const bus::Participant& participant, bus::Directory directory, ProcessReaders processes)
      : participant_(&participant), directory_(std::move(directory)), processes_(std::move(processes)) {}

  void Follow(const bus::Presence& presence) {
    if (presence.kind == bus::PresenceKind::kRelay) return;  // it says nothing that is shown
    if (presence.wire != bus::kWireVersion || campaigns_.size() + runs_.size() >= kMostWatched) return;
    if (refused_.contains(presence.id)) return;
    const std::string partition = bus::Owner{presence.name, presence.id}.partition();
    if (presence.kind == bus::PresenceKind::kCampaign && !campaigns_.contains(presence.id)) {
      auto readers = CampaignReaders::Open(*participant_, partition);
      if (readers)
        campaigns_.emplace(presence.id, std::move(*readers));
      else
        Refuse(presence, readers.error());
    }
    if (presence.kind != bus::PresenceKind::kCampaign && !runs_.contains(presence.id)) {
      auto readers = RunReaders::Open(*participant_, partition);
      if (readers)
        runs_.emplace(presence.id, std::move(*readers));
      else
        Refuse(presence, readers.error());
    }
  }

  // An identity of one campaign or run may not read the others: that is said once, and not tried again.
  void Refuse(const bus::Presence& presence, const Error& error) {
    if (refused_.size() >= kMostRefused) refused_.clear();
    if (participant_->secured()) refused_.insert(presence.id);
    Log().warn("{} {}@{} is left out: {}", bus::ToString(presence.kind), presence.name, presence.id, error.message);
  }

  const bus::Participant* participant_;
  bus::Directory directory_;
  ProcessReaders processes_;
  std::set<std::string> refused_;  // ids
  std::map<std::string, CampaignReaders> campaigns_;
  std::map<std::string, RunReaders> runs_;
};

}  // namespace

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

Result<std::vector<Sample>> BusWatch::Newest(const std::string& topic) {
  const auto known = bus::KnownTopics();
  if (std::ranges::find(known, topic) == known.end())
    return Fail(Code::kNotFound, "topic " + NotKnown(topic.substr(0, 100), known));
  if (monitor::IsBulk(topic))
    return Fail(Code::kInvalidArgument,
                fmt::format("topic '{}' carries episodes: reading it would double their traffic; "
                            "its rate is counted by those who write it",
                            topic));
  const auto now = MonotonicClock::now();
  MutexLock lock(mutex_);
  std::erase_if(wishes_, [&](const auto& item) { return item.second.until < now; });
  if (!wishes_.contains(topic) && wishes_.size() >= kMostWishes)
    return Fail(Code::kUnavailable, fmt::format("{} topics are being read already", kMostWishes));
  Wish& wish = wishes_[topic];
  wish.until = now + kWishStands;
  return wish.samples;
}

void BusWatch::Serve(SampleTap& tap) {
  std::vector<std::string> topics;
  {
    const auto now = MonotonicClock::now();
    MutexLock lock(mutex_);
    std::erase_if(wishes_, [&](const auto& item) { return item.second.until < now; });
    for (const auto& [topic, wish] : wishes_) topics.push_back(topic);
  }
  const auto samples = tap.Read(topics);
  MutexLock lock(mutex_);
  for (const auto& [topic, newest] : samples)
    if (const auto wish = wishes_.find(topic); wish != wishes_.end()) wish->second.samples = newest;
}

// Until `stop`. @returns why the bus cannot be had
Status BusWatch::Read(LiveModel& model, const std::stop_token& stop) {
  ETUDE_ASSIGN_OR_RETURN(auto participant, arguments_.Open({security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(auto ears, Ears::Open(participant));
  model.view().error.clear();
  const auto reporter = bus::ProcessReporter::Start(participant, {.role = "gateway"});
  if (!reporter) Log().warn("this gateway does not say how it is: {}", reporter.error().message);
  SampleTap tap(participant);
  TimePoint looked{};
  while (!stop.stop_requested()) {
    ears.Listen(model);  // first: after a stall, what waits in the readers says that nobody was silent
    if (MonotonicClock::now() - looked >= kDirectory) {
      ears.LookAround(model);
      looked = MonotonicClock::now();
    }
    Serve(tap);
    Publish(model.view());
    std::this_thread::sleep_for(kLook);
  }
  return {};
}

// An interface, a free index or a profile that can be read may be there later: a gateway lives for weeks.
void BusWatch::Run(std::stop_token stop) {
  LiveModel model;
  model.view().enabled = true;
  while (!stop.stop_requested()) {
    const Status read = Read(model, stop);
    if (read) return;
    if (std::exchange(model.view().error, read.error().message) != read.error().message)
      Log().warn("the bus is not read, and tried again every {} s: {}", kTryAgain.count(), read.error().message);
    Publish(model.view());
    const auto next = MonotonicClock::now() + kTryAgain;
    while (!stop.stop_requested() && MonotonicClock::now() < next) std::this_thread::sleep_for(kLook);
  }
}

}  // namespace etude::live
