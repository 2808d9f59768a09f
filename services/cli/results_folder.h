// SPDX-License-Identifier: Apache-2.0
// What lies in the folder of `etude results`: whether it is what a row asks for.
#pragma once

#include <cstdint>
#include <optional>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::cli {

/// Episodes of a dataset by what a training does with them; those for tests are none of it.
struct Demonstrations {
  std::uint64_t train = 0, valid = 0, test = 0;

  std::uint64_t all() const { return train + valid + test; }
};

/// @error kNotFound, kCorrupt: no dataset
Result<Demonstrations> CountDemonstrations(const Path& data);
/// A collection that was stopped ends well, too: a run on what there is would be another one. Episodes that it gave up
/// count as collected, for no collector tries them again; how many trained is the table's to show.
/// @param wanted  episodes; 0: as many as the dataset's campaign asks for
/// @error of CountDemonstrations; kNotFound: fewer, and how many
Status CheckWholeDataset(const Path& data, std::uint64_t wanted);

/// A run that was removed and trained again leaves its evaluation behind. Nothing is wrong where there is none, it does
/// not say its checkpoint's hash, or the checkpoint is gone.
/// @param evaluation  folder of eval.json
/// @error kInvalidArgument: it is of another checkpoint than the file holds now; says what to remove. Of the disk
Status CheckEvaluated(const Path& evaluation, const Path& checkpoint);

/// Seconds that a run was trained, over all its starts, without waiting for first data: as it said at its end.
/// @returns none where RUN/metrics.jsonl does not say
std::optional<double> TrainingSeconds(const Path& run);
/// Whether its last training came to its end, as RUN/metrics.jsonl says: one that somebody stopped has not.
bool HasFinished(const Path& run);
/// After a trainer that ended well, as one that somebody stopped does, too. @error kExhausted: it has not finished
Status CheckFinished(const Path& run);

}  // namespace etude::cli
