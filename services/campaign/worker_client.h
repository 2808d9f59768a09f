// SPDX-License-Identifier: Apache-2.0
// The worker's side of a campaign: join, lease, work, send, report. Generic over the work, so that it can
// be tested with a fake one; worker/work.cc binds it to the simulation.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "services/bus/participant.h"
#include "services/campaign/fingerprint.h"
#include "services/core/result.h"
#include "services/episode/attempt_times.h"
#include "services/spec/campaign_spec.h"
#include "services/spec/content_version.h"
#include "services/spec/sampling_weights.h"

namespace etude::campaign {

/// Says how far the attempt is; from the thread of the work function.
using ProgressFunction = std::function<void(std::string_view stage, std::uint32_t step)>;

struct WorkItem {
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  SamplingWeights weights;  ///< that hold for `index`
  ProgressFunction progress = nullptr;
};

struct WorkResult {
  /// EncodeEpisode's bytes. Empty: the attempt failed, `outcome` says why.
  std::vector<std::uint8_t> episode;
  std::string outcome;
  std::string details_json = "{}";
  std::uint64_t steps = 0, frames = 0;  ///< for telemetry
  AttemptTimes times;  ///< where the time went; wall_s is filled in by the client. Beside the episode, never in it
};

/// Does one attempt. An Error ends the worker (the machine is at fault), after releasing the lease.
using WorkFunction = std::function<Result<WorkResult>(const WorkItem&)>;
/// The campaign that a worker has joined.
struct JoinedCampaign {
  std::string id;
  CampaignSpec spec;
  std::string policy;  ///< whom rollouts ask: RUN or RUN@ID (see services/policy/client.h)
  /// SpecHash of `spec`, and so of what its task files have to say. Empty: it is not compared.
  std::string spec_sha256 = {};
  /// For a factory to call while it takes long: the service manager is told that it moves. May be empty.
  std::function<void()> moved = nullptr;
  /// What the worker said that its bytes depend on; empty: it did not say.
  Fingerprint fingerprint = {};
};
/// Makes the function for a campaign; called again when the spec changes, or another campaign of the name takes the
/// place of one that has gone, not for each shard. Factory and function run on the thread that called Run.
using WorkFactory = std::function<Result<WorkFunction>(const JoinedCampaign&)>;

struct WorkerOptions {
  std::string campaign;  ///< NAME, or NAME@ID of one of several; with NAME alone the same user's next one follows
  std::string name;      ///< unique on the bus; empty: UniquePeerName()
  std::uint32_t content = kContentVersion;
  bool once = false;  ///< one attempt, then home
  /// While it works it asks for the next lease, so that it need not wait for it; what it does not begin is handed back.
  bool prefetch = false;
  std::chrono::milliseconds idle_timeout{0};  ///< without work for so long it goes home; 0: it waits for ever
  /// SHA-256 over the files that a spec names (robots, objects), "" when it names none. The collector lets work only
  /// those who have the same ones; asked for again after each attempt, whose result counts only where it is as before.
  /// Left out: "".
  std::function<Result<std::string>(const CampaignSpec&)> files_sha256;
  /// What its bytes of a campaign depend on; the collector lets work only those who agree as the campaign's
  /// `determinism` asks for. Left out: not compared.
  std::function<Result<Fingerprint>(const CampaignSpec&)> fingerprint;
  std::chrono::milliseconds heartbeat{500};
  std::chrono::milliseconds ask_again{1'000};      ///< a request without an answer is repeated
  std::chrono::milliseconds send_timeout{30'000};  ///< per try; the same object is sent again
  /// At one shard of several that has work, about; then chance says which is next, so that shards that began at
  /// different times come to have as many workers.
  std::chrono::milliseconds stay{300'000};
};

class WorkerClient {
 public:
  /// `participant` must outlive the client. @error kInvalidArgument: not a campaign's name; of the bus.
  static Result<WorkerClient> Open(const bus::Participant& participant, const WorkerOptions& options);
  WorkerClient(WorkerClient&&) noexcept;
  WorkerClient& operator=(WorkerClient&&) noexcept;
  ~WorkerClient();

  const std::string& name() const;

  /// Waits for the campaign, then works until it is complete, a stop is requested, or nobody had work for
  /// `idle_timeout`; all of them are success. Of a campaign that several collectors share it asks one until that has
  /// nothing to lease, then the next, and it is complete when all those are that were ever seen (NAME@ID: that one).
  /// A collector that restarts is waited for. On a stop the lease is released.
  /// @error kInvalidArgument: the name means several campaigns (the message lists them); kUnavailable: the collector
  /// has another wire or content number, or the work function's error.
  Status Run(const WorkFactory& factory);

 private:
  struct Impl;
  explicit WorkerClient(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::campaign
