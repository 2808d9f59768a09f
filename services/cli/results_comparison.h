// SPDX-License-Identifier: Apache-2.0
// Two rows' rollouts of the same scenes, as their reports have them.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "services/cli/results_table.h"
#include "services/core/statistics.h"

namespace etude::cli {

/// Of one training seed or of several, which counts differ from each other.
struct PairedRollouts {
  std::uint64_t n = 0, both = 0, only_first = 0, only_second = 0, seeds = 0;

  /// Of one seed's report; none where its comparison is missing, or its counts are none.
  static std::optional<PairedRollouts> From(const OrderedJson& report);
  /// Of all seeds; no rollouts (n = 0) where the comparison of one is missing.
  static PairedRollouts Of(const ResultLine& line);

  void Add(const PairedRollouts& other);
  /// Points, the other row's successes taken off the row's own. @pre n > 0
  double difference() const;
  /// Of the difference, points. Several seeds' rollouts of a scene are no independent cases, which it would take them
  /// for. @pre n > 0, one seed
  Interval interval() const;
  /// Cells of a table: rollouts, successes only here, only there, the difference, and of one seed its interval and
  /// whether it may be chance. @pre n > 0
  std::string text() const;
};

/// A report has no more than the name of the row that it was compared with, and the hash of the rollouts: either may be
/// of another one by now. What is not with the rollouts of the row that `compare` names, as `lines` have them, becomes
/// missing.
std::vector<ResultLine> WithComparisonsThatHold(std::vector<ResultLine> lines);

}  // namespace etude::cli
