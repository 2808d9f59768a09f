// SPDX-License-Identifier: Apache-2.0
// The worker's side of a campaign: join, lease, work, send, report. Generic over the work, so that it can
// be tested with a fake one; worker/main.cc binds it to the simulation.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "services/bus/participant.h"
#include "services/core/command.h"
#include "services/core/result.h"
#include "services/episode/campaign_spec.h"

namespace etude::campaign {

struct WorkItem {
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
};

struct WorkResult {
  /// EncodeEpisode's bytes. Empty: the attempt failed, `outcome` says why.
  std::vector<std::uint8_t> episode;
  std::string outcome;
  std::string details_json = "{}";
  std::uint64_t steps = 0, frames = 0;  ///< for telemetry
};

/// Does one attempt. An Error ends the worker (the machine is at fault), after handing the lease back.
using WorkFunction = std::function<Result<WorkResult>(const WorkItem&)>;
/// Makes the function for a campaign; called again when the campaign's spec changes. Factory and function
/// run on the thread that called Run.
using WorkFactory = std::function<Result<WorkFunction>(const CampaignSpec&)>;

struct WorkerOptions {
  std::string campaign;
  std::string name;  ///< unique on the bus; empty: UniquePeerName()
  std::string version = Version();
  bool once = false;  ///< one attempt, then home
  /// SHA-256 over the files that a spec names (robots, objects), "" when it names none. The collector lets work only
  /// those who have the same ones. Left out: "".
  std::function<Result<std::string>(const CampaignSpec&)> files_sha256;
  std::chrono::milliseconds heartbeat{500};
  std::chrono::milliseconds ask_again{1'000};      ///< a request without an answer is repeated
  std::chrono::milliseconds send_timeout{30'000};  ///< per try; the same object is sent again
};

class WorkerClient {
 public:
  static Result<WorkerClient> Open(const bus::Participant& participant, const WorkerOptions& options);
  WorkerClient(WorkerClient&&) noexcept;
  WorkerClient& operator=(WorkerClient&&) noexcept;
  ~WorkerClient();

  const std::string& name() const;

  /// Waits for the campaign, then works until it is complete or a stop is requested; both are success.
  /// A collector that restarts is waited for. On a stop the lease is handed back.
  /// @error kUnavailable: the collector is of another version, or the work function's error.
  Status Run(const WorkFactory& factory);

 private:
  struct Impl;
  explicit WorkerClient(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Outcome of an AttemptReport that gives the lease back undone; nothing is counted.
inline constexpr char kHandedBack[] = "handed_back";
/// Outcome of a rollout whose policy did not answer; the same attempt is tried again.
inline constexpr char kPolicyError[] = "policy_error";

}  // namespace etude::campaign
