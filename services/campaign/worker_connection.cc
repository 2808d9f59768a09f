// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/worker_connection.h"

#include <utility>

#include "services/campaign/lease_table.h"
#include "services/core/identity.h"
#include "services/core/log.h"

namespace etude::campaign {

Result<std::unique_ptr<WorkerConnection>> WorkerConnection::Open(const bus::Participant& participant,
                                                                 std::shared_ptr<KnownCollector> collector,
                                                                 const WorkerOptions& options,
                                                                 bus::WorkerStatus status) {
  const bus::Presence& found = collector->presence;
  const bus::Owner owner{found.name, found.id};
  const std::string partition = owner.partition();
  // before the requests: who is asked can then answer at once
  ETUDE_ASSIGN_OR_RETURN(auto leases,
                         bus::Reader<bus::Lease>::Open(participant, owner.address_partition(participant.address())));
  ETUDE_ASSIGN_OR_RETURN(auto requests, bus::Writer<bus::WorkRequest>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto reports, bus::Writer<bus::AttemptReport>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto heartbeats, bus::Writer<bus::WorkerStatus>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto sender, bus::BlobSender::Open(participant, owner, "episode", options.name));
  status.campaign = found.name;
  status.campaign_id = found.id;
  status.worker = options.name;
  status.host = HostName();
  status.phase = "idle";
  std::string id = found.id;  // `collector` is moved
  return std::unique_ptr<WorkerConnection>(
      new WorkerConnection{.collector = std::move(collector),
                           .id = std::move(id),
                           .worker = options.name,
                           .leases = std::move(leases),
                           .requests = std::move(requests),
                           .reports = std::move(reports),
                           .sender = std::move(sender),
                           .heartbeat = std::make_unique<Heartbeat>(std::move(heartbeats), status, options.heartbeat)});
}

void WorkerConnection::Ask(const bus::WorkRequest& request) {
  asked = request.request_id;
  answered = false;
  if (const Status written = requests.Write(request); !written) Log().warn("request: {}", written.error().message);
}

bool WorkerConnection::IsAnswer(const bus::Lease& lease, std::uint64_t request) const {
  return lease.worker == worker && lease.campaign_id == id && lease.request_id == request;
}

void WorkerConnection::TakeAnswerAhead() {
  if (asked == 0 || ahead) return;
  for (auto& lease : leases.Take()) {
    if (!IsAnswer(lease, asked)) continue;
    answered = true;
    if (lease.kind == bus::LeaseKind::kWork) ahead = std::move(lease);
  }
}

std::optional<bus::Lease> WorkerConnection::TakeAhead(const std::string& spec_sha256) {
  TakeAnswerAhead();
  asked = 0;
  auto lease = std::exchange(ahead, std::nullopt);
  const bool holds =
      lease && EpochOf(lease->token) == collector->announcement->epoch && lease->spec_sha256 == spec_sha256;
  return holds ? std::move(lease) : std::nullopt;
}

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

}  // namespace etude::campaign
