// SPDX-License-Identifier: Apache-2.0
// A collector in this process and its local workers: what collect, eval and up have in common.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include "services/bus/participant.h"
#include "services/campaign/collector.h"
#include "services/cli/worker_pool.h"
#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/core/result.h"
#include "services/spec/campaign_spec.h"

namespace etude::cli {

struct HostOptions {
  BusArguments bus;
  int workers = 1;  ///< 0: only others' workers
  Path out;         ///< what the collector opens
  Path logs;
  Shard shard;                    ///< the episodes that are this collector's; its local workers work for it alone
  Claim claim = Claim::kRefuse;   ///< when the folder's id is live elsewhere
  std::string policy_id;          ///< the run whose policy rollouts ask; "": whoever serves its name
  std::string run_id;             ///< the run whose validation errors count; "": the first that speaks
  campaign::EvalSubject subject;  ///< of an evaluation: what is evaluated
  std::chrono::milliseconds unheard{30'000};  ///< without a word of any worker: that is said
  Path worker;                                ///< its program; empty: the sibling etude-worker
};

/// Runs the collector on a thread of its own and supervises the workers from the caller's.
class HostedCampaign {
 public:
  static Result<std::unique_ptr<HostedCampaign>> Start(const bus::Participant& participant, const CampaignSpec& spec,
                                                       const HostOptions& options);
  /// Drains: workers end first, then the collector.
  ~HostedCampaign();

  /// Call a few times a second. @error of the workers (WorkerPool::Supervise); the collector's own is Finish's.
  Status Supervise();
  /// True when the collector has ended: complete, or stopped.
  bool ended() const;
  /// Ends workers and collector; returns the collector's own status.
  Status Finish();
  campaign::CollectorProgress progress() const;

 private:
  HostedCampaign() = default;
  void SayUnheard(const campaign::CollectorProgress& progress);
  struct Host;
  std::unique_ptr<Host> host_;
  std::optional<WorkerPool> pool_;
  Path logs_;
  std::chrono::milliseconds unheard_{};
  Stopwatch since_start_;
  bool heard_ = false;  // a worker was, or it has been said that none is
};

/// @error kExhausted: a complete campaign has given up every episode: there is nothing to go on with
Status CheckNotAllGivenUp(const campaign::CollectorProgress& progress, const Path& dataset);

}  // namespace etude::cli
