// SPDX-License-Identifier: Apache-2.0
// Asks a policy over the bus: an observation out, an action back. What a robot's driver does, too.
#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "services/bus/participant.h"
#include "services/core/result.h"
#include "worker/task/attempt.h"

namespace etude {

struct PolicyClientOptions {
  std::chrono::milliseconds answer{3'000};     ///< then the observation is sent again
  std::chrono::milliseconds patience{60'000};  ///< over all tries; a server may still load its checkpoint
};

/// One conversation with the policy server of a run. Not thread-safe.
class PolicyClient {
 public:
  static Result<PolicyClient> Open(const bus::Participant& participant, const std::string& run,
                                   const std::string& session, const PolicyClientOptions& options = {});
  PolicyClient(PolicyClient&&) noexcept;
  PolicyClient& operator=(PolicyClient&&) noexcept;
  ~PolicyClient();

  /// @error kUnavailable: no answer within the patience, or the server's own refusal; kCorrupt: waypoints of
  /// a wrong number or not finite; kTimeout: a stop was requested meanwhile.
  Result<task::PolicyAnswer> Ask(const task::PolicyQuestion& question);

 private:
  struct Impl;
  explicit PolicyClient(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude
