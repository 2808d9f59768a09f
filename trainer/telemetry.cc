// SPDX-License-Identifier: Apache-2.0
#include "trainer/telemetry.h"

#include <chrono>
#include <utility>

#include "services/core/disk_wait.h"
#include "services/core/log.h"
#include "services/core/run_name.h"
#include "services/core/stop.h"

namespace etude {
namespace {

bus::TrainStatus ToMessage(const publish::RunIdentity& run, const learn::Progress& progress) {
  bus::TrainStatus status;
  status.run = run.name;
  status.run_id = run.id;
  status.step = progress.step;
  status.stage = static_cast<std::uint32_t>(progress.stage);
  status.stages = static_cast<std::uint32_t>(progress.stages);
  status.stage_name = progress.stage_name;
  status.loss = progress.loss;
  status.samples_per_second = progress.samples_per_second;
  status.data_wait = progress.data_wait;
  status.episodes = progress.train_episodes;
  status.eta_s = progress.eta_s;
  status.checkpoint_step = progress.checkpoint_step;
  status.metrics_json = OrderedJson(progress.metrics).dump();
  status.finished = progress.finished;
  return status;
}

}  // namespace

Result<Telemetry> Telemetry::Open(const bus::Participant* participant, const std::string& name, const Path& folder,
                                  Claim claim) {
  // a full disk is waited for, as it is later
  ETUDE_RETURN_IF_ERROR(CheckMayWrite(folder));
  std::string id;
  ETUDE_RETURN_IF_ERROR(WriteWhenThereIsRoom("the run's id and name", [&]() -> Status {
    ETUDE_ASSIGN_OR_RETURN(const Identity identity, OpenIdentity(folder, claim));
    id = identity.id;
    return KeepRunName(folder, name);
  }));
  Telemetry telemetry;
  telemetry.run_ = {name, id, publish::NextStart(folder)};
  if (!participant) return telemetry;
  bus::Presence presence = bus::MakePresence(bus::PresenceKind::kRun, name, id, folder.string());
  presence.epoch = telemetry.run_.start;
  ETUDE_ASSIGN_OR_RETURN(telemetry.presence_, bus::Announcement::Open(*participant, presence, claim));
  telemetry.run_.start = telemetry.presence_->presence().epoch;
  ETUDE_ASSIGN_OR_RETURN(telemetry.writer_,
                         bus::Writer<bus::TrainStatus>::Open(*participant, bus::Owner{name, id}.partition()));
  return telemetry;
}

void Telemetry::Say(const learn::Progress& progress) {
  if (!writer_) return;
  if (const Status written = writer_->Write(ToMessage(run_, progress)); !written)
    Log().debug("telemetry: {}", written.error().message);
  const auto successor = superseded_ ? std::nullopt : presence_->Successor();
  if (!successor) return;
  superseded_ = bus::GivingWay(presence_->presence(), *successor);
  RequestStop();
}

ErrorPublisher::ErrorPublisher(const bus::Participant* participant, const data::Dataset& dataset,
                               const std::string& run_id)
    : participant_(participant), dataset_(dataset.path()) {
  message_.campaign = dataset.spec().name;
  message_.run_id = run_id;
}

void ErrorPublisher::Say(const std::vector<ErrorCell>& cells, std::uint64_t step) {
  message_.step = step;
  message_.errors_json = ErrorCellsText(cells);
  const Status said = writer_ ? writer_->Write(message_) : Join();
  if (!said) Log().warn("cannot tell campaign={} where validation errs: {}", message_.campaign, said.error().message);
}

// not before there is something to say: a folder gets its id a moment after its dataset
Status ErrorPublisher::Join() {
  ETUDE_ASSIGN_OR_RETURN(const Identity campaign, ReadIdentity(dataset_));
  message_.campaign_id = campaign.id;
  const bus::Owner owner{message_.campaign, campaign.id};
  ETUDE_ASSIGN_OR_RETURN(writer_, bus::Writer<bus::ValidationErrors>::Open(*participant_, owner.partition()));
  constexpr std::chrono::seconds kPatience{5};
  if (!writer_->WaitForReaders(1, kPatience)) return {};  // it may be complete, and its collector gone
  return writer_->Write(message_);
}

}  // namespace etude
