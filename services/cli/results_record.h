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
  std::string made;                    ///< "2026-11-22, AMD EPYC, 2 CPUs"
  OrderedJson report;                  ///< of eval.json what tables show: "overall", "per_task"
  double training_s = 0;               ///< that the training took, without waiting for data; 0: not known
  std::uint64_t train = 0, valid = 0;  ///< demonstrations that it learned from and was validated on; 0: not known

  void Visit(auto& v) {
    v("seed", seed, "-", "of the training");
    v("made", made, "", "when and on which machine");
    v("report", report, "", "overall and per task, as eval.json has them");
    v("training_s", training_s, "s", "that the training took; 0: not known");
    v("train", train, "-", "demonstrations for training; 0: not known");
    v("valid", valid, "-", "demonstrations for validation");
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
  /// dropped: one row never mixes two. A report that says what the kept one says (but for the comparison) is the same
  /// one, read again: that keeps its day and machine, and a comparison that could not be made again with the same row.
  /// Of the same training of a seed, what is not known any more is kept also where the row is evaluated otherwise.
  void Keep(const ResultRow& row, ResultReport report);
  /// Of `row` as it is defined now, in the order of its seeds.
  std::vector<ResultReport> Find(const ResultRow& row) const;
};

/// What of a row decides its figures: data, training but for its seeds, evaluation, and of the row that it begins with
/// the same but for its evaluation. Its words, the paper's figure and the goal do not. Keys that have their default are
/// left out, so that a new key does not make other rows of those that were measured.
OrderedJson DefinitionOf(const ResultRow& row);
/// Whether what an earlier version wrote, defaults and all, is the definition `now`.
bool IsDefinition(const OrderedJson& before, const OrderedJson& now);
/// OUT/rows/NAME.json holds the definition that what lies in OUT was made of, whose folders have no more than the row's
/// name. Nothing is wrong where there is no such file. @param out  the folder of data/, runs/ and eval/
/// @error kInvalidArgument: it is another definition than the row has now; says what to remove to make the row again.
Status CheckDefinition(const Path& out, const ResultRow& row);
/// The same of what the row's runs were made of: in which scenes they are rolled out is no matter of theirs.
Status CheckRuns(const Path& out, const ResultRow& row);
/// CheckDefinition, and writes the file where there is none.
Status KeepDefinition(const Path& out, const ResultRow& row);

/// "2026-11-22, AMD EPYC, 2 CPUs": today, here.
std::string MadeHere();

}  // namespace etude::cli
