// SPDX-License-Identifier: Apache-2.0
// The content of a checkpoint. Metadata keys (all text): format, version, run, step, stage, stages,
// stage_name, train_episodes, dataset (fingerprint), joints, architecture
// (policy::ArchitectureHash), metrics, policy_config and train_config (JSON, resolved). Tensors:
// Policy::StateTensors, normalisation included.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/result.h"
#include "trainer/learn/trainer.h"
#include "trainer/policy/policy.h"

namespace etude::publish {

struct CheckpointInfo {
  std::string run, version, stage_name, dataset, architecture;
  std::uint64_t step = 0, train_episodes = 0;
  int stage = 1, stages = 1;
  int joints = 0;
  OrderedJson metrics, train_config;
};

struct Checkpoint {
  CheckpointInfo info;
  policy::PolicyConfig policy;
  std::map<std::string, torch::Tensor> tensors;
};

/// The bytes of a checkpoint file; a pure function of the request.
/// @error kInvalidArgument: a tensor of a type that cannot be saved.
Result<std::vector<std::uint8_t>> EncodeCheckpoint(const learn::CheckpointRequest& request, const std::string& run);

/// @error kCorrupt: not safetensors, not a checkpoint, metadata that does not parse, an
/// architecture hash that is not the config's; kInvalidArgument: another version of Etude wrote it.
/// The message says which, and what is here.
Result<Checkpoint> DecodeCheckpoint(std::span<const std::uint8_t> bytes);
Result<Checkpoint> ReadCheckpoint(const Path& path);

/// The network with these weights, in evaluation mode. @error kCorrupt: tensors that do not fit the
/// architecture.
Result<std::shared_ptr<policy::Policy>> BuildPolicy(const Checkpoint& checkpoint);

}  // namespace etude::publish
