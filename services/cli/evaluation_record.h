// SPDX-License-Identifier: Apache-2.0
// What an evaluation's report says beyond its rollouts: which checkpoint they were of, and where their videos are.
#pragma once

#include <span>
#include <vector>

#include "services/campaign/eval_report.h"
#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::cli {

/// What a checkpoint says of itself.
struct CheckpointFacts {
  campaign::EvalSubject subject;  ///< `run_id` and `created` are left empty
  std::string refused;            ///< why it may not drive a robot; "": it may
};
/// @param bytes  of the file   @error kCorrupt: no safetensors file
Result<CheckpointFacts> FactsOfCheckpoint(std::span<const std::uint8_t> bytes, const Path& file);

/// Fills in what is known once the rollouts are over: each row's "video" and "insight" (the file), relative to OUT,
/// and, of a run that was followed, the checkpoint where all rollouts were of one. Where they were of several, none is
/// named: the rows say which. Writes OUT/eval.json and OUT/eval.jsonl. @pre nobody else writes them any more.
/// @param run_folder  of the run that was followed; "": not known
/// @returns the report. @error of the disk; kCorrupt
Result<OrderedJson> CompleteReport(const Path& out, const Path& run_folder, const std::vector<Path>& videos,
                                   const std::vector<Path>& insights = {});

}  // namespace etude::cli
