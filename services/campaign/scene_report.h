// SPDX-License-Identifier: Apache-2.0
// Which scenes an evaluation counted: how often the first start that was drawn was taken, why others were not, and
// which scenes do not count because the task cannot be done in them.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "services/core/file.h"
#include "services/episode/attempt_details.h"
#include "services/episode/episode.h"

namespace etude::campaign {

/// Not thread-safe.
class SceneReport {
 public:
  /// A rollout that counts. The same index again replaces what was there.
  void Add(const Episode& rollout);
  /// A failed attempt; only "scene_invalid" is looked at. `details` as the worker reported them.
  void AddFailure(std::uint64_t index, const std::string& outcome, const OrderedJson& details);
  /// The failed attempts that an earlier life of the collector recorded. @param folder  of attempts.jsonl
  void Restore(const Path& folder);

  /// {"filter": "feasible" | "first_draw", "scenes", "first_draw": share, "draws", "rejected": {reason: starts},
  /// "invalid": n, "invalid_reasons": {reason: n}}.
  OrderedJson Json(const std::string& filter) const;

 private:
  std::map<std::uint64_t, SceneTally> counted_;
  std::map<std::uint64_t, std::string> invalid_;  ///< index -> reason
};

/// Two or three lines below the table of an evaluation. @param report  eval.json, with "scenes"; "" without.
std::string ScenesText(const OrderedJson& report);

}  // namespace etude::campaign
