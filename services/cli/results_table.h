// SPDX-License-Identifier: Apache-2.0
// The table of `etude results`, from evaluations' reports.
#pragma once

#include <string>
#include <vector>

#include "services/cli/results_config.h"
#include "services/core/config.h"

namespace etude::cli {

/// One row that was measured.
struct ResultLine {
  const ResultRow* row = nullptr;
  std::vector<OrderedJson> reports;  ///< eval.json of each seed
};

/// Markdown: a line a row (strict success as the mean over the seeds with the Wilson interval of all rollouts, latched
/// beside it, demonstrations, minutes, what it began with, the paper's figure, the goal), then success by task.
/// Rows without reports are left out.
std::string ResultsTable(const std::vector<ResultLine>& lines);

}  // namespace etude::cli
