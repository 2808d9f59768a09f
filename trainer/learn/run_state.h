// SPDX-License-Identifier: Apache-2.0
// What a run needs to go on bit for bit: one safetensors file.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/file.h"
#include "trainer/checkpoint/metadata.h"
#include "trainer/policy/torch.h"

namespace etude::learn {

/// In the run's folder.
inline constexpr const char* kRunStateFile = "training_state.safetensors";

struct RunState {
  std::map<std::string, torch::Tensor> policy;     ///< Policy::StateTensors, raw (not averaged) weights
  std::map<std::string, torch::Tensor> optimizer;  ///< Optimizer::StateTensors
  torch::Tensor rng;                               ///< torch's default generator
  std::uint64_t step = 0;
  double elapsed_s = 0;      ///< of training, all runs together
  OrderedJson limit;         ///< RunLimit::Save
  OrderedJson curriculum;    ///< Scheduler::Save
  std::string architecture;  ///< policy::ArchitectureHash
  checkpoint::Embodiment embodiment;
  std::map<std::string, checkpoint::ModuleRecord> modules;
  std::string words;                      ///< TrainingRun::words; "" in states of before
  std::vector<std::uint64_t> validation;  ///< numbers (EpisodeEntry) of the episodes that are validated on
  std::vector<std::string> datasets;  ///< spec hashes of its folders, in their order; older states of one folder: none
  /// Of the network that every batch was cut for, those of all ranks together: a batch is normalised part by part. 0:
  /// of a device that trains one, or of a state of before.
  int replicas = 0;
  int best_stage = 0;
  double best_score = 0;  ///< of the best checkpoint so far, lower is better
  std::uint64_t checkpoint_step = 0;
  std::map<std::string, double> metrics;  ///< of the last validation; files of before have none
};

/// By rename: a reader sees the old one or the new one.
Status SaveRunState(const Path& path, const RunState& state);
/// @error kNotFound, kCorrupt (says what); kInvalidArgument when it is of another layout: of another program.
Result<RunState> LoadRunState(const Path& path);

}  // namespace etude::learn
