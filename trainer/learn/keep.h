// SPDX-License-Identifier: Apache-2.0
// What a run leaves behind: config.yaml, checkpoints (through the hook) and the state that --resume needs.
#pragma once

#include <functional>
#include <string>

#include "trainer/learn/run.h"

namespace etude::learn {

/// WriteWhenThereIsRoom, that asks for the run's source while it waits: whoever watches the run hears of it, and so do
/// the other ranks, which would count rank 0 as lost. The wait is no time of training.
Status WriteOrWait(TrainingRun& run, const std::string& what, const std::function<Status()>& write);

/// config.yaml, resolved; the limit as it is by now. @error of the disk.
Status KeepConfig(TrainingRun& run);

/// A checkpoint, then the state: a run that dies between them repeats steps and loses none.
/// @error of the hook, of the disk.
Status KeepNow(TrainingRun& run, const Hooks& hooks, bool best);

/// The averaged weights, when there are any, with batch-normalisation statistics measured with them (Izmailov et al.
/// 2018, "Averaging weights leads to wider optima", section 3.2), in the place of the front replica's own; those come
/// back when it is destroyed. Statistics of the raw weights belong to a network that nobody evaluates.
class AveragedWeights {
 public:
  explicit AveragedWeights(TrainingRun& run);
  ~AveragedWeights();
  AveragedWeights(const AveragedWeights&) = delete;
  AveragedWeights& operator=(const AveragedWeights&) = delete;

 private:
  void Measure();
  void GiveBack();

  TrainingRun& run_;
  std::map<std::string, torch::Tensor> own_;  ///< running statistics of the raw weights
};

}  // namespace etude::learn
