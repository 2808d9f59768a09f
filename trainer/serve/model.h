// SPDX-License-Identifier: Apache-2.0
// A checkpoint that answers observations.
#pragma once

#include <memory>
#include <span>
#include <string>

#include "services/bus/messages.h"
#include "trainer/publish/checkpoint.h"

namespace etude::serve {

/// Immutable; Answer may be called from several threads at once.
class Model {
 public:
  /// @error as DecodeCheckpoint and BuildPolicy.
  static Result<std::shared_ptr<const Model>> FromBytes(std::span<const std::uint8_t> bytes);
  static Result<std::shared_ptr<const Model>> FromFile(const Path& path);

  const publish::CheckpointInfo& info() const { return checkpoint_.info; }
  const policy::PolicyConfig& config() const { return checkpoint_.policy; }
  const std::string& sha256() const { return sha256_; }

  /// Waypoints and the modules' outputs. An observation that does not fit (picture size, number of
  /// joints, numbers that are not finite) is answered with `error` set and nothing else. A pure
  /// function of the observation and the checkpoint.
  bus::Action Answer(const bus::Observation& observation) const;

 private:
  Model() = default;
  Result<policy::Inputs> Prepare(const bus::Observation& observation) const;
  OrderedJson Describe(const policy::Outputs& outputs) const;

  publish::Checkpoint checkpoint_;  // without tensors: the policy has them
  std::string sha256_;
  std::shared_ptr<policy::Policy> policy_;
};

}  // namespace etude::serve
