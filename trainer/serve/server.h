// SPDX-License-Identifier: Apache-2.0
// The policy server's loop: observations in, actions out, weights swapped between two answers.
#pragma once

#include <atomic>
#include <memory>
#include <optional>
#include <string>

#include "services/bus/object_channel.h"
#include "services/bus/participant.h"
#include "trainer/serve/model.h"

namespace etude::serve {

struct ServerOptions {
  std::string run;                 ///< partition of observations and actions
  std::string channel = "latest";  ///< of the checkpoints to follow: latest | best
  int threads = 1;                 ///< observations evaluated side by side
};

/// Serves one run. Observations are read only once there is a model, so that a client that waits
/// for a matched reader starts when it can be answered.
class PolicyServer {
 public:
  /// @param model  to begin with; none: waits for the first checkpoint (`follow`)
  static Result<PolicyServer> Open(const bus::Participant& participant, const ServerOptions& options,
                                   std::shared_ptr<const Model> model);
  /// Also takes every checkpoint published on the run's partition from now on.
  Status Follow();
  PolicyServer(PolicyServer&&) noexcept;
  PolicyServer& operator=(PolicyServer&&) noexcept;
  ~PolicyServer();

  /// Until a stop request or Stop().
  Status Run();
  void Stop();

  std::uint64_t answered() const;
  std::uint64_t refused_checkpoints() const;
  std::uint64_t checkpoint_step() const;  ///< 0: none yet

 private:
  struct Impl;
  explicit PolicyServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::serve
