// SPDX-License-Identifier: Apache-2.0
// What a run learns from: classes, tasks, words, cameras, the kind of robot.
#pragma once

#include <string>
#include <vector>

#include "trainer/learn/run.h"

namespace etude::learn {

/// What sentences call the dataset's objects (ObjectNoun), each once, in their order.
std::vector<std::string> NounsOf(const data::Dataset& dataset);

/// RunState::datasets of `dataset`.
std::vector<std::string> DatasetsOf(const data::Dataset& dataset);

/// The robot, camera and formats of every episode in `snapshot`. A camera that moves within a folder, or will, is part
/// of what is learned, and then any other folder's, too; each of two that stand still has its own policy.
/// @error kInvalidArgument: an episode that is of another kind than the first, with both files and what differs
Result<checkpoint::Embodiment> FindEmbodiment(const data::Dataset& dataset, const data::Snapshot& snapshot);

/// The run's grammar, words and maker of batches, and what the data say of its policy: classes, tasks, the crop.
/// @error kInvalidArgument: a module that drives is about an object that the data do not have; as
/// language::Grammar::LoadFor and policy::ResolveCrop
Status MakeBatchMaker(const data::Snapshot& snapshot, TrainingRun& run);

/// Adds `text` to the run's words: those that a training before had, which what is copied of it, or goes on, still
/// knows.
void AddWords(const std::string& text, TrainingRun& run);

}  // namespace etude::learn
