// SPDX-License-Identifier: Apache-2.0
// What a worker and the collector that it is at say to each other. Internal to services/campaign.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "services/bus/blob_transfer.h"
#include "services/bus/topic.h"
#include "services/campaign/heartbeat.h"
#include "services/campaign/known_collectors.h"
#include "services/campaign/worker_client.h"
#include "services/core/clock.h"
#include "services/core/service_manager.h"

namespace etude::campaign {

/// Of one worker, from joining a collector to leaving it. One thread at a time.
struct WorkerConnection {
  std::shared_ptr<KnownCollector> collector;
  std::string id;      ///< the collector's
  std::string worker;  ///< its name
  bus::Reader<bus::Lease> leases;
  bus::Writer<bus::WorkRequest> requests;
  bus::Writer<bus::AttemptReport> reports;
  bus::BlobSender sender;
  std::unique_ptr<Heartbeat> heartbeat;
  std::optional<bus::AttemptReport> last_report = std::nullopt;  ///< of the last attempt that failed
  std::optional<bus::Lease> ahead = std::nullopt;                ///< beside the one that is worked on
  std::uint64_t asked = 0;  ///< the request whose answer was not taken up yet; 0: none
  bool answered = false;    ///< it came, with a lease or that there is none
  Stopwatch since_joined = {};
  Stopwatch since_lease = {};  ///< since it was joined, or leased something

  /// @param status  what was counted so far. `participant` must outlive it. @error of the bus
  static Result<std::unique_ptr<WorkerConnection>> Open(const bus::Participant& participant,
                                                        std::shared_ptr<KnownCollector> collector,
                                                        const WorkerOptions& options, bus::WorkerStatus status);

  /// Asks for work; one that is lost is asked again, by the worker.
  void Ask(const bus::WorkRequest& request);
  /// Whether `lease` is the answer to the request of this number.
  bool IsAnswer(const bus::Lease& lease, std::uint64_t request) const;
  /// Keeps the answer to `asked` where it has come.
  void TakeAnswerAhead();
  /// What was leased meanwhile; nothing where the collector has begun another life since, or has another spec.
  std::optional<bus::Lease> TakeAhead(const std::string& spec_sha256);
};

/// What tells `heartbeat` how far an attempt is, and the service manager that it moves. Both must outlive it.
ProgressFunction ProgressTo(Heartbeat& heartbeat, WatchedLoop& watched);

}  // namespace etude::campaign
