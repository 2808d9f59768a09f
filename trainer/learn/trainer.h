// SPDX-License-Identifier: Apache-2.0
// The training loop of one run.
//
//   ETUDE_ASSIGN_OR_RETURN(auto trainer, Trainer::Create(config, dataset, options, hooks));
//   ETUDE_RETURN_IF_ERROR(trainer->Run());      // until the limit, or a stop request
//
// Files of a run: config.yaml (resolved), metrics.jsonl, events.out.tfevents.*, curriculum.jsonl,
// training_state.safetensors (all that --resume needs, by rename).
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "trainer/data/dataset.h"
#include "trainer/learn/config.h"
#include "trainer/learn/evaluate.h"
#include "trainer/policy/policy.h"

namespace etude::learn {

/// Where a run is; for telemetry and the progress line.
struct Progress {
  std::uint64_t step = 0;
  int stage = 1, stages = 1;
  std::string stage_name;
  double progress = 0;  ///< of the limit, [0, 1]
  double loss = 0;      ///< mean of the last steps
  double samples_per_second = 0;
  double data_wait = 0;  ///< fraction of the step's time
  std::uint64_t train_episodes = 0;
  double eta_s = 0;
  std::uint64_t checkpoint_step = 0;
  std::map<std::string, double> metrics;  ///< of the last validation
  bool finished = false;
};

/// Weights to be kept, and what they are.
struct CheckpointRequest {
  std::uint64_t step = 0;
  int stage = 1, stages = 1;
  std::string stage_name;
  bool best = false;  ///< the best so far: both channels
  std::map<std::string, double> metrics;
  std::string dataset;  ///< fingerprint of the training split
  std::uint64_t train_episodes = 0;
  int joints = 0;  ///< arm and gripper joints of an observation
  const TrainConfig* config = nullptr;
  std::map<std::string, torch::Tensor> tensors;  ///< Policy::StateTensors, averaged weights when ema > 0
};

/// Called from the training thread. A failed checkpoint stops the run with its error.
struct Hooks {
  std::function<Status(const CheckpointRequest&)> on_checkpoint;
  std::function<void(const Progress&)> on_progress;  ///< about once a second, and at the end
};

struct RunOptions {
  Path out;  ///< the run's folder
  bool resume = false;
  bool follow = false;  ///< the dataset still grows
};

/// Thread safety: one thread. Creating it needs at least one episode in each of train and valid
/// (with `follow` it waits for data.min_episodes of them, or a stop request).
class Trainer {
 public:
  /// @error kInvalidArgument (config; resume of another architecture), kNotFound (no data, no state
  /// to resume), kCorrupt (state), kUnavailable (disk).
  static Result<std::unique_ptr<Trainer>> Create(const TrainConfig& config, std::shared_ptr<data::Dataset> dataset,
                                                 const RunOptions& options, const Hooks& hooks);
  ~Trainer();

  /// Trains until the limit or a stop request; either way the state and a checkpoint are saved, and
  /// it is no error. @error kInternal when the loss is not finite: then nothing is saved and the
  /// last checkpoint stands.
  Status Run();
  Progress progress() const;

 private:
  struct Impl;
  explicit Trainer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::learn
