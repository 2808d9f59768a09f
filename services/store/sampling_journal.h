// SPDX-License-Identifier: Apache-2.0
// From which episode on which sampling weights hold: DATASET/sampling.jsonl, a SamplingEntry a line. With it a dataset
// stays a function of what lies in its folder: episode i is one of (spec, journal, i, attempt).
//
//   ETUDE_ASSIGN_OR_RETURN(auto journal, SamplingJournal::Open("out/data", spec));
//   const EpisodePlan plan = PlanEpisode(spec, index, attempt, journal.At(index));
#pragma once

#include <cstdint>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "services/spec/sampling_weights.h"

namespace etude::store {

/// Lines are only ever added, each for larger indices than the ones before it. Its one writer is the collector, which
/// holds the dataset's lock. Const methods are thread-safe.
class SamplingJournal {
 public:
  /// Empty where the folder has no such file.
  /// @error kCorrupt: a line that is no entry, or that does not fit the spec or the line before; kUnavailable
  static Result<SamplingJournal> Open(const Path& folder, const CampaignSpec& spec);

  const std::vector<SamplingEntry>& entries() const { return entries_; }
  /// The entry that holds for an episode; nullptr before the first.
  const SamplingEntry* EntryAt(std::uint64_t index) const;
  /// Its weights; none before the first.
  const SamplingWeights& At(std::uint64_t index) const;
  /// The first index that the next entry may begin with: `adaptive_sampling.every` after the last one's. The largest
  /// number when there are kMostEntries.
  std::uint64_t next_from() const;

  /// Durable when it returns. On error the entry does not hold here, but may stand on the disk: no episode from its
  /// first on may be made before an Append has succeeded, which takes its place there.
  /// @error kInvalidArgument: it begins before next_from(), or its weights do not pass CheckWeights; kUnavailable
  Status Append(const SamplingEntry& entry);

  static constexpr std::size_t kMostEntries = 1000;

 private:
  SamplingJournal(Path file, CampaignSpec spec) : file_(std::move(file)), spec_(std::move(spec)) {}
  Status Check(const SamplingEntry& entry) const;

  Path file_;
  CampaignSpec spec_;
  std::vector<SamplingEntry> entries_;
};

}  // namespace etude::store
