// SPDX-License-Identifier: Apache-2.0
// What a run says of itself on the bus while it trains.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/security/checkpoint_signature.h"
#include "services/spec/sampling_weights.h"
#include "trainer/data/dataset.h"
#include "trainer/learn/trainer.h"
#include "trainer/publish/sink.h"

namespace etude {

/// A run on the bus: it is in the directory and says how it goes. Not thread-safe.
class Telemetry {
 public:
  /// Settles who the run is: its folder's id, the name that the folder keeps, and a start that is larger than any
  /// before. Without a participant only that. @error kUnavailable: the id is live elsewhere (see Claim).
  static Result<Telemetry> Open(const bus::Participant* participant, const std::string& name, const Path& folder,
                                Claim claim);

  const publish::RunIdentity& run() const { return run_; }
  void SignWith(std::shared_ptr<const security::CheckpointSigner> signer) { run_.signer = std::move(signer); }
  /// Also looks whether another one has taken over the id; then it asks this process to stop.
  void Say(const learn::Progress& progress);
  /// Why the run was stopped, when another one has the better right to its id.
  Status status() const { return superseded_ ? Status(Fail(*superseded_)) : Status(); }

 private:
  publish::RunIdentity run_;
  std::optional<bus::Announcement> presence_;
  std::optional<bus::Writer<bus::TrainStatus>> writer_;
  std::optional<Error> superseded_;
};

/// Tells the campaign that grows the dataset where validation errs. What cannot be said is logged: training goes on.
/// Not thread-safe.
class ErrorPublisher {
 public:
  ErrorPublisher(const bus::Participant* participant, const data::Dataset& dataset, const std::string& run_id);

  void Say(const std::vector<ErrorCell>& cells, std::uint64_t step);

 private:
  Status Join();

  const bus::Participant* participant_;
  Path dataset_;
  bus::ValidationErrors message_;
  std::optional<bus::Writer<bus::ValidationErrors>> writer_;
};

}  // namespace etude
