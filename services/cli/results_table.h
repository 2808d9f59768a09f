// SPDX-License-Identifier: Apache-2.0
// The table of `etude results`, from evaluations' reports.
#pragma once

#include <string>
#include <vector>

#include "services/cli/results_record.h"

namespace etude::cli {

/// One row that was measured.
struct ResultLine {
  const ResultRow* row = nullptr;
  std::vector<ResultReport> reports;  ///< of each seed
};

/// Markdown: a line a row (strict success as the share of all seeds' rollouts with its Wilson interval, each seed's
/// share, latched likewise, demonstrations, minutes, what it began with, the paper's figure, the goal, when and where
/// it was made), then other goals (modules' errors are those of all decisions, before and after the contact), success
/// by task, the modules' errors, and comparisons with other rows in the same scenes. Rows without reports are left out.
/// A comparison is missing where it is with another row than `compare` names, or with other rollouts of that row than
/// `lines` have; with one seed's missing there is no difference of all seeds, nor a goal that is held against it. The
/// difference of several seeds has neither interval nor p: their rollouts of a scene are no independent cases.
/// The intervals are of the rollouts of these very runs: they say how well those are known, not how far another
/// training seed may be from them. That is what the seeds' own shares show.
std::string ResultsTable(const std::vector<ResultLine>& lines);

}  // namespace etude::cli
