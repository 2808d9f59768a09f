// SPDX-License-Identifier: Apache-2.0
// Results as they were measured, kept beside the table, so that rows made on several days or machines make one table.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/cli/results_config.h"
#include "services/core/config.h"
#include "services/core/file.h"

namespace etude::cli {

/// One training seed of a row.
struct ResultReport {
  std::uint64_t seed = 0;
  std::string made;    ///< "2026-11-22, AMD EPYC, 2 CPUs"
  OrderedJson report;  ///< of eval.json what tables show: "overall", "per_task"

  void Visit(auto& v) {
    v("seed", seed, "-", "of the training");
    v("made", made, "", "when and on which machine");
    v("report", report, "", "overall and per task, as eval.json has them");
  }
};

/// What was measured of one row.
struct ResultRecord {
  std::string row;
  OrderedJson definition;  ///< what of the row decides the figures: data, train but for its seeds, eval
  std::vector<ResultReport> reports;

  void Visit(auto& v) {
    v("row", row, "", "its name");
    v("definition", definition, "", "data, training and scenes that it was made of");
    v("reports", reports, "", "one a training seed");
  }
};

/// The file beside the table, "results.json". Not thread-safe.
struct ResultRecords {
  std::vector<ResultRecord> rows;

  void Visit(auto& v) { v("rows", rows, "", "that were measured"); }

  /// @returns none where there is no file. @error kInvalidArgument: not such a file
  static Result<ResultRecords> Load(const Path& file);
  Status Save(const Path& file) const;

  /// Keeps a report in the place of an earlier one of that seed. What was measured of another definition of the row is
  /// dropped: one row never mixes two.
  void Keep(const ResultRow& row, ResultReport report);
  /// Of `row` as it is defined now, in the order of its seeds.
  std::vector<ResultReport> Find(const ResultRow& row) const;
};

/// What tables show of an eval.json. Numbers of a report that another version wrote may be missing.
OrderedJson BriefReport(const OrderedJson& report);
/// "2026-11-22, AMD EPYC, 2 CPUs": today, here.
std::string MadeHere();

}  // namespace etude::cli
