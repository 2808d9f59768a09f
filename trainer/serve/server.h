// SPDX-License-Identifier: Apache-2.0
// The policy server's loop: observations in, actions out, weights swapped between two answers.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "services/bus/blob_transfer.h"
#include "services/bus/participant.h"
#include "services/core/identity.h"
#include "services/relay/kept_checkpoints.h"
#include "trainer/policy/clip/text_encoder.h"
#include "trainer/serve/latency.h"
#include "trainer/serve/model.h"

namespace etude::serve {

struct ServerOptions {
  Selector run;                    ///< whose checkpoints are served: NAME, or NAME@ID
  std::string folder;              ///< of the checkpoint that is served, for people
  std::string channel = "latest";  ///< of the checkpoints to follow: latest | best
  /// Whose checkpoints an earlier server of `run` followed: it gives way to its own user's next run alone.
  std::optional<relay::KeptOwner> before = {};
  /// Whose checkpoints of the run are taken, see BlobSubscriber; empty: all.
  std::function<Status(const bus::PublishedBlob&)> accept;
  int threads = 1;                     ///< observations evaluated side by side
  torch::Device device = torch::kCPU;  ///< where they are
  /// Of policies whose language is clip:DIR; open for as long as the server.
  std::shared_ptr<clip::Folders> clip_folders = std::make_shared<clip::Folders>();
  /// Of another DDS domain, where observations are answered too and from which nothing else is taken; none: nullptr.
  /// Outlives the server.
  const bus::Participant* robots = nullptr;
};

/// Serves one run. Observations are read only once there is a model, so that a client that waits
/// for a matched reader starts when it can be answered.
class PolicyServer {
 public:
  /// @param participant  outlives the server
  /// @param model  to begin with, served under `options.run` with its whole id; none: waits for the first checkpoint
  ///               (Follow)
  /// @error kInvalidArgument: a model without a whole id; robots in the same domain
  static Result<PolicyServer> Open(const bus::Participant& participant, const ServerOptions& options,
                                   std::shared_ptr<const Model> model);
  /// Also takes every checkpoint that the run publishes from now on. With its name alone: of the run of that name,
  /// and when that has gone, of the next one; the old model serves until the new run's first checkpoint.
  Status Follow();
  PolicyServer(PolicyServer&&) noexcept;
  PolicyServer& operator=(PolicyServer&&) noexcept;
  ~PolicyServer();

  /// Until a stop request or Stop(). @error kInvalidArgument: the run's name means several (the message lists them)
  Status Run();
  void Stop();

  std::uint64_t answered() const;
  std::uint64_t refused_checkpoints() const;
  Latency latency() const;
  std::uint64_t checkpoint_step() const;  ///< 0: none yet

 private:
  struct Impl;
  explicit PolicyServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::serve
