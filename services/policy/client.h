// SPDX-License-Identifier: Apache-2.0
// Asks a policy over the bus: an observation out, an action back. What a robot's driver does, too.
#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "services/bus/participant.h"
#include "services/core/result.h"
#include "services/policy/policy_types.h"

namespace etude::policy {

struct ClientOptions {
  std::chrono::milliseconds answer{3'000};     ///< then the observation is sent again
  std::chrono::milliseconds patience{60'000};  ///< over all tries; a server may still load its checkpoint
};

/// One conversation with the policy server of a run. Not thread-safe.
class Client {
 public:
  /// @param run  NAME, or NAME@ID where several runs of a name are served. The server need not be there yet; with NAME
  ///             alone, when the server that answered has gone, the next one of that name is asked.
  /// @param participant  must outlive the client
  /// @param session  unique among all who ask
  /// @error kInvalidArgument: not a name; of the bus.
  static Result<Client> Open(const bus::Participant& participant, const std::string& run, const std::string& session,
                             const ClientOptions& options = {});
  Client(Client&&) noexcept;
  Client& operator=(Client&&) noexcept;
  ~Client();

  /// @error kUnavailable: no answer within the patience, or the server's own refusal that may pass; kInvalidArgument:
  /// the policy was trained for something else, its rotations are written in another way than here, or the name means
  /// several policy servers (the message lists them); kCorrupt: of this question the policy makes nothing that can be
  /// followed, waypoints of a wrong number or not finite, and would again; kTimeout: a stop was requested meanwhile. A
  /// rotation is NaN where a network's six numbers are none (zero, parallel): who drives refuses it.
  Result<Answer> Ask(const Question& question);

 private:
  struct Impl;
  explicit Client(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::policy
