// SPDX-License-Identifier: Apache-2.0
// What is counted of a dataset.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "services/episode/attempt_details.h"
#include "services/store/commit_journal.h"
#include "services/store/dataset.h"

namespace etude::store::internal {

struct EpisodeSummary {
  std::string task, target, outcome;
  bool success = false;
  std::uint64_t steps = 0;
  std::uint64_t samples = 0;  ///< images' rate, robomimic's num_samples
  std::uint64_t frames = 0;   ///< of all cameras
  std::uint64_t bytes = 0;    ///< of the file
  SceneTally scene;           ///< how its scene was found
  PlanTally planned;          ///< how its stages were planned
};

EpisodeSummary Summarize(const Episode& episode, std::uint64_t frames, std::uint64_t bytes);
/// Of the file of `record`.
EpisodeSummary Summarize(const EpisodeRecord& record);
/// Of a line of the journal. @pre it is counted
EpisodeSummary SummaryOf(const CommitRow& row);

/// What is counted of a dataset while it grows: an episode costs the same, however many there are.
class Statistics {
 public:
  void Add(const CampaignSpec& spec, std::uint64_t index, const EpisodeSummary& episode);
  /// Counts by task, target, split; sums; see DatasetInfo.
  OrderedJson Json() const;

 private:
  std::map<std::string, std::uint64_t> tasks_, targets_, outcomes_;
  std::map<std::string, std::uint64_t> splits_{{"train", 0}, {"valid", 0}, {"test", 0}};
  EpisodeSummary sum_;
  std::uint64_t episodes_ = 0, successes_ = 0;
};

OrderedJson StatisticsOf(const CampaignSpec& spec, const std::map<std::uint64_t, EpisodeSummary>& episodes);

/// What an episode has: [{"name", "dtype", "shape", "rate_hz"}, ...]; the first extent is of time.
OrderedJson FeatureTable(const Episode& episode);

/// Failed attempts by outcome, as attempts.jsonl tells; lines that do not parse are left out.
std::map<std::string, std::uint64_t> FailuresByOutcome(const Path& dataset);

}  // namespace etude::store::internal
