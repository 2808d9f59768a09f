// SPDX-License-Identifier: Apache-2.0
// What Episode::details says of an attempt, counted over many. Written by worker/task; the one place where it is read
// back. Details come over the bus: what is missing or of another kind is left out.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "services/core/config.h"

namespace etude {

using Counts = std::map<std::string, std::uint64_t>;

/// How scenes were found. details["scene"] = {"draws": n, "rejected": [{"reason", "detail"}, ...]}: of n starts that
/// were drawn the last was taken, and each one before was not, for a reason of few words.
struct SceneTally {
  std::uint64_t scenes = 0, first_draw = 0, draws = 0;
  Counts rejected;  ///< reason -> starts

  void Add(const OrderedJson& details);
  void Add(const SceneTally& other);
  /// {"scenes", "first_draw": share 0..1, "draws", "rejected": {...}}; "first_draw" is left out when there are none.
  OrderedJson Json() const;
};

/// How stages were planned. details["planned"] = [{"stage", "way"}, ...].
struct PlanTally {
  std::map<std::string, Counts> ways;  ///< stage -> line | detour | rrt | field | field_escaped -> times

  void Add(const OrderedJson& details);
  void Add(const PlanTally& other);
  /// {STAGE: {"times", WAY: share 0..1, ...}, ...}
  OrderedJson Json() const;
};

/// "reach: out_of_reach 9, approach: touches 4", the most frequent first; "" of nothing.
std::string Text(const Counts& counts);

}  // namespace etude
