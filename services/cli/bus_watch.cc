// SPDX-License-Identifier: Apache-2.0
#include "services/cli/bus_watch.h"

#include <algorithm>
#include <set>

#include "services/bus/access.h"
#include "services/bus/directory.h"
#include "services/bus/process_reporter.h"
#include "services/bus/topic.h"
#include "services/core/log.h"
#include "services/core/stop.h"

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

constexpr auto kForgotten = 60s;  // of silence

struct CampaignReaders {
  bus::Reader<bus::CampaignStatus> statuses;
  bus::Reader<bus::WorkerStatus> workers;
};

struct RunReaders {
  bus::Reader<bus::TrainStatus> statuses;
  bus::Reader<bus::PolicyStatus> policies;
};

// Under its name, which is read before it is moved from.
template <class Message>
void Hear(Message&& message, std::string Message::*name, std::map<std::string, Heard<Message>>& heard) {
  const std::string key = message.*name;
  heard[key] = {std::move(message), MonotonicClock::now()};
}

template <class Message>
void Forget(std::map<std::string, Heard<Message>>& heard) {
  const auto now = MonotonicClock::now();
  std::erase_if(heard, [&](const auto& item) { return now - item.second.at > kForgotten; });
}

}  // namespace

struct BusWatch::Impl {
  const bus::Participant* participant = nullptr;
  bus::Directory directory;
  bus::Reader<bus::ProcessStatus> processes;
  std::map<std::string, CampaignReaders> campaigns;  // by id
  std::map<std::string, RunReaders> runs;            // by id
  BusView view;

  Status Find();
  Status JoinCampaign(const bus::Presence& presence);
  Status JoinRun(const bus::Presence& presence);
  void TakeCampaign(const std::string& id, CampaignReaders& readers);
  void TakeRun(const std::string& id, RunReaders& readers);
};

Status BusWatch::Impl::JoinCampaign(const bus::Presence& presence) {
  view.campaigns[presence.id].presence = presence;
  if (campaigns.contains(presence.id)) return {};
  const std::string partition = bus::Owner{presence.name, presence.id}.partition();
  ETUDE_ASSIGN_OR_RETURN(auto statuses, bus::Reader<bus::CampaignStatus>::Open(*participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto workers, bus::Reader<bus::WorkerStatus>::Open(*participant, partition));
  campaigns.emplace(presence.id, CampaignReaders{std::move(statuses), std::move(workers)});
  return {};
}

Status BusWatch::Impl::JoinRun(const bus::Presence& presence) {
  RunView& run = view.runs[presence.id];
  run.name = presence.name;
  run.id = presence.id;
  if (runs.contains(presence.id)) return {};
  const std::string partition = bus::Owner{presence.name, presence.id}.partition();
  ETUDE_ASSIGN_OR_RETURN(auto statuses, bus::Reader<bus::TrainStatus>::Open(*participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto policies, bus::Reader<bus::PolicyStatus>::Open(*participant, partition));
  runs.emplace(presence.id, RunReaders{std::move(statuses), std::move(policies)});
  return {};
}

// Who is there now; a name that somebody else made cannot be a partition of ours.
Status BusWatch::Impl::Find() {
  std::set<std::string> there;
  for (const auto& presence : directory.Live()) {
    if (!IsPlainName(presence.name) || !IsId(presence.id)) continue;
    there.insert(presence.id);
    const bool campaign = presence.kind == bus::PresenceKind::kCampaign;
    const Status joined = campaign ? JoinCampaign(presence) : JoinRun(presence);
    // an identity of one campaign or run may not read the others
    if (!joined && participant->secured()) {
      (campaign ? void(view.campaigns.erase(presence.id)) : void(view.runs.erase(presence.id)));
      Log().debug("{}@{} is left out: {}", presence.name, presence.id, joined.error().message);
      continue;
    }
    ETUDE_RETURN_IF_ERROR(joined);
  }
  const auto gone = [&](const auto& item) { return !there.contains(item.first); };
  std::erase_if(campaigns, gone);
  std::erase_if(runs, gone);
  std::erase_if(view.campaigns, gone);
  std::erase_if(view.runs, gone);
  return {};
}

void BusWatch::Impl::TakeCampaign(const std::string& id, CampaignReaders& readers) {
  CampaignView& campaign = view.campaigns[id];
  const auto now = MonotonicClock::now();
  for (auto& status : readers.statuses.Take())
    if (status.campaign_id == id) campaign.status = {std::move(status), now};
  for (auto& status : readers.workers.Take())
    if (status.campaign_id == id) Hear(std::move(status), &bus::WorkerStatus::worker, campaign.workers);
  Forget(campaign.workers);
}

void BusWatch::Impl::TakeRun(const std::string& id, RunReaders& readers) {
  RunView& run = view.runs[id];
  const auto now = MonotonicClock::now();
  for (auto& status : readers.statuses.Take())
    if (status.run_id == id) run.status = {std::move(status), now};
  for (auto& status : readers.policies.Take())
    if (status.run_id == id) Hear(std::move(status), &bus::PolicyStatus::server, run.policies);
  // a policy server speaks every second: it ends sooner than a worker is given up
  std::erase_if(run.policies, [&](const auto& item) { return now - item.second.at > 10s; });
}

BusWatch::BusWatch(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
BusWatch::BusWatch(BusWatch&&) noexcept = default;
BusWatch& BusWatch::operator=(BusWatch&&) noexcept = default;
BusWatch::~BusWatch() = default;

Result<BusWatch> BusWatch::Open(const bus::Participant& participant) {
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  ETUDE_ASSIGN_OR_RETURN(auto processes, bus::Reader<bus::ProcessStatus>::Open(participant, bus::kDirectoryPartition));
  std::unique_ptr<Impl> impl(
      new Impl{.participant = &participant, .directory = std::move(directory), .processes = std::move(processes)});
  impl->view.domain = participant.domain();
  return BusWatch(std::move(impl));
}

Status BusWatch::Look() {
  ETUDE_RETURN_IF_ERROR(impl_->Find());
  for (auto& [id, readers] : impl_->campaigns) impl_->TakeCampaign(id, readers);
  for (auto& [id, readers] : impl_->runs) impl_->TakeRun(id, readers);
  for (auto& status : impl_->processes.Take())
    Hear(std::move(status), &bus::ProcessStatus::process, impl_->view.processes);
  Forget(impl_->view.processes);
  return {};
}

Status BusWatch::LookAround(std::chrono::milliseconds patience) {
  const auto end = MonotonicClock::now() + patience;
  do {
    ETUDE_RETURN_IF_ERROR(Look());
  } while (MonotonicClock::now() < end && !WaitForStop(50ms));
  return Look();
}

const BusView& BusWatch::view() const { return impl_->view; }

}  // namespace etude::cli
