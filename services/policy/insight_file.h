// SPDX-License-Identifier: Apache-2.0
// What a policy said at each decision of a rollout, kept in a file beside it: `etude eval --insight` writes it, whoever
// looks into a rollout without a policy server reads it.
//
// The first line is JSON:
//   {"format": "etude-insights-1", "index": 3, "seed": "81234", "attempt": 0,
//    "decisions": [{"step": 0, "bytes": 4210, "size": 9120}, {"step": 30, "bytes": 0, "size": 0}, ...]}
// Behind its end are the decisions' blocks in that order, `bytes` each: a zlib stream of `size` bytes. Size 0: the
// decision has no insight, and no block. A block is a line of JSON and behind its end one byte a weight:
//   {"checkpoint_step", "modules", "attention", "view": [u, v, width, height], "waypoints": [x, y, z, ... of each]}
// "attention" says as bus::Insight::attention_json (trainer/serve/insight.h) where each head's bytes are and what they
// mean: weight = byte / 255 * scale. So a byte of a weight is kept, a reader inflates the decision that it wants and no
// other, and what it reads is checked as what comes over the bus is. Words and joints and what-ifs are not kept: they
// are answers to questions that nobody asked.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "services/core/descriptor.h"
#include "services/core/file.h"
#include "services/core/result.h"
#include "services/policy/insight.h"

namespace etude::policy {

/// By the control step of the decision; nothing for one that has none.
using InsightsByStep = std::map<int, std::optional<Insight>>;

inline constexpr std::uint64_t kMostInsightFile = 64ull << 20;  ///< bytes of a file
inline constexpr std::uint64_t kMostInsight = 8ull << 20;       ///< bytes of a decision, inflated
inline constexpr std::size_t kMostKeptDecisions = 4096;         ///< of a rollout

/// "000031.insights"
std::string InsightFileName(std::uint64_t index);

/// Whose insights they are.
struct InsightsOf {
  std::uint64_t index = 0, seed = 0;
  std::uint32_t attempt = 0;
  bool operator==(const InsightsOf&) const = default;
};

/// Writes the file atomically. A decision too large for the bounds above, or the ones behind the last that fits, have
/// none in the file.
/// @returns how many decisions have theirs. @error of the disk
Result<std::size_t> WriteInsightFile(const Path& path, const InsightsOf& of, const InsightsByStep& insights);

/// Reads its first line; a decision when it is asked for. Not thread-safe.
class InsightFile {
 public:
  struct Decision {
    int step = 0;
    std::uint64_t offset = 0, bytes = 0, size = 0;  ///< of its block; size 0: it has none

    bool kept() const { return size > 0; }
  };

  static Result<InsightFile> Open(const Path& path);
  /// @param path  for the words of errors   @error kCorrupt, kUnavailable
  static Result<InsightFile> Open(Descriptor file, const Path& path);

  const InsightsOf& of() const { return of_; }
  const std::vector<Decision>& decisions() const { return decisions_; }  ///< in the order of their steps
  /// @error kNotFound: there is no such decision, or it has no insight; kCorrupt, kUnavailable
  Result<Insight> At(std::size_t decision) const;

 private:
  InsightFile(Descriptor file, Path path) : file_(std::move(file)), path_(std::move(path)) {}
  Status ReadIndex();

  Descriptor file_;
  Path path_;
  InsightsOf of_;
  std::vector<Decision> decisions_;
};

}  // namespace etude::policy
