// SPDX-License-Identifier: Apache-2.0
// What a run begins with: a checkpoint's parts, or the state that it left.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "trainer/learn/run.h"

namespace etude::learn {

/// Puts into each of `policies` what `init` asks of its checkpoint, and into the run what that says of them: modules'
/// records, words, the level at which there is something to learn. @pre run.scheduler is there
/// @error as checkpoint::ReadFile and checkpoint::Operate
Status BeginWithCheckpoint(TrainingRun& run, std::vector<std::shared_ptr<policy::Policy>>& policies);

/// The experiment that trained `source`, where this run's is another one: with a checkpoint comes its graph alone, not
/// how it was trained. "": it is the same, or not known
std::string OtherRecipe(const checkpoint::Metadata& source, const TrainConfig& config);

/// Of a run that begins with no checkpoint. @error kInvalidArgument: parts that are to stay as they are
Status CheckNothingIsKept(const InitConfig& init);

/// Nothing where the run does not go on. @error as LoadRunState
Result<std::optional<RunState>> StateToResume(const RunOptions& options);

/// That what was saved is of this network, robot and camera, and of these datasets. @error kInvalidArgument: which not
Status CheckFits(const RunState& state, const TrainingRun& run);

/// As where a run begins with a checkpoint: what has not begun to learn never would, and nothing that reads it may
/// drive. @error kInvalidArgument: frozen modules that have not
Status CheckFrozenLearned(const RunState& state, const TrainingRun& run);

/// All of `state` but the weights. @pre run.optimizer, run.scheduler and run.validation are there
/// @error as Optimizer::LoadStateTensors, and the others' Restore
Status RestoreState(const RunState& state, TrainingRun& run);

/// Tells people what is frozen. Of what learned until now, checkpoints had the average over the last steps; frozen it
/// is as the last step left it.
void LogFrozen(const RunState& state, const TrainingRun& run);

}  // namespace etude::learn
