// SPDX-License-Identifier: Apache-2.0
// The training loop of one run.
//
//   ETUDE_ASSIGN_OR_RETURN(auto trainer, Trainer::Create(config, dataset, options, hooks));
//   ETUDE_RETURN_IF_ERROR(trainer->Run());      // until the limit, or a stop request
//
// Files of a run: config.yaml (resolved), metrics.jsonl, events.out.tfevents.*, curriculum.jsonl,
// training_state.safetensors (all that --resume needs, by rename).
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "services/spec/sampling_weights.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/data/dataset.h"
#include "trainer/learn/config.h"
#include "trainer/learn/ranks.h"

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

/// Called from the training thread. A failed checkpoint stops the run with its error.
struct Hooks {
  /// Weights to be kept (averaged ones when ema > 0) and what they are; the run's name is left to the callee.
  std::function<Status(const checkpoint::Checkpoint&)> on_checkpoint;
  std::function<void(const Progress&)> on_progress;  ///< about once a second, and at the end
  /// After a validation, where the policy errs, and the step. Left out: it is not measured.
  std::function<void(const std::vector<ErrorCell>&, std::uint64_t step)> on_errors = nullptr;
  /// Whether the checkpoint that was made at a step is still there: a resumed run makes one that is not. Left out: it
  /// is.
  std::function<bool(std::uint64_t step)> has_checkpoint = nullptr;
  /// Whether the best one is: where it is gone, the next that is measured is the best. Left out: it is.
  std::function<bool()> has_best = nullptr;
};

struct RunOptions {
  Path out;  ///< the run's folder
  bool resume = false;
  bool follow = false;  ///< the dataset still grows
  /// How whoever collects the data is, asked about once a second; an error ends the run with its words, saved.
  std::function<Status()> source;
  /// Whether that has come to its end, so that no more data come; empty: unknown.
  std::function<bool()> over;
  std::chrono::milliseconds patience{60'000};  ///< with `follow`: silence after which nothing more is expected
  /// Others that train the same network; those but rank 0 write nothing. None: it trains alone.
  std::shared_ptr<Ranks> ranks;
  torch::Device device = torch::kCPU;  ///< where the network is trained (policy/device.h)
  int replicas = 0;                    ///< where threads.replicas and the run's own state leave it open; 0: one a core
};

/// @error kInvalidArgument: neither steps nor minutes
Status RequireLimit(const TrainConfig& config);

/// Says what Trainer::Create would refuse whatever the data are: the configuration, its limit, and files that a run
/// begins with or, with `resume`, goes on with. @error as Trainer::Create
Status CheckBeginning(const TrainConfig& config, bool resume);

/// Thread safety: one thread. Creating it needs at least one episode in each of train and valid; with `follow` it
/// waits for enough of them (await_data.h).
class Trainer {
 public:
  /// @error kInvalidArgument (config; resume of another architecture, robot or camera), kNotFound (no data, no state
  /// to resume), kExhausted (a growing dataset that does not grow), kCorrupt (state), kUnavailable (disk).
  static Result<std::unique_ptr<Trainer>> Create(const TrainConfig& config, std::shared_ptr<data::Dataset> dataset,
                                                 const RunOptions& options, const Hooks& hooks);
  ~Trainer();

  /// Trains until the limit or a stop request; either way the state and a checkpoint are saved, and
  /// it is no error. A source that fails ends it alike, with the source's error, and so does a lost rank, at rank 0,
  /// with kUnavailable. @error kInternal when the loss is not finite: then nothing is saved and the last checkpoint
  /// stands.
  Status Run();

 private:
  struct Impl;
  explicit Trainer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::learn
