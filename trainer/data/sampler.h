// SPDX-License-Identifier: Apache-2.0
// Which frames and which sentences make batch number `step`: pure functions, so that a run that
// resumes continues with the same order and threads cannot change it.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/language/grammar.h"
#include "trainer/data/dataset.h"

namespace etude::data {

/// One picture of a batch, and the seed of every other choice made for it (sentences, crop,
/// colour).
struct Sample {
  FrameRef frame;
  std::uint64_t seed = 0;
};

/// `batch` frames with replacement; tasks take turns, frames of a task are uniform, but that of those at rest
/// (EpisodeEntry::AtRest) only the share `rest`, in (0, 1], is taken and the others are drawn again. `retry` draws
/// anew (for a frame whose file turned out to be bad). Empty when the split has no frames.
std::vector<Sample> DrawBatch(const Snapshot& snapshot, Split split, std::uint64_t seed, std::uint64_t step, int batch,
                              int retry = 0, double rest = 1);

/// At most `count` frames, the same ones for the same snapshot, spread evenly over tasks and
/// episodes.
std::vector<Sample> SpreadFrames(const Snapshot& snapshot, Split split, std::uint64_t seed, int count);

/// What the episode demonstrates.
language::Command CommandOf(const Episode& episode);

/// What sentence s of a picture asks about: s = 0 the demonstrated command; s >= 1 relabelled, the
/// other objects of the scene in random order (again from the start when there are fewer than
/// `sentences`), each with a random verb of `tasks`. The obstacle stays what it is and is never a target; a
/// relation refers to any other object that it may.
std::vector<language::Command> DrawCommands(const Episode& episode, const std::vector<std::string>& tasks,
                                            int sentences, std::uint64_t seed);

/// Language that the dataset's tasks lack: of the relabelled commands (not of the first, which a trajectory belongs to)
/// a `share` is given something to keep off (everything else, the obstacle, another object of the scene), or a second
/// object of the scene, by one of `tasks`. What the sentence's verb is about stays, so that grounding learned from it
/// outlives modules that are added later.
void AddClauses(const Episode& episode, const std::vector<std::string>& tasks, double share, std::uint64_t seed,
                std::vector<language::Command>& commands);

}  // namespace etude::data
