// SPDX-License-Identifier: Apache-2.0
// Where a collector puts what arrives: a dataset of demonstrations, or the report of an evaluation.
#pragma once

#include <cstdint>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "services/campaign/eval_report.h"
#include "services/core/file.h"
#include "services/core/result.h"
#include "services/episode/episode.h"
#include "services/spec/campaign_spec.h"
#include "services/store/commit_journal.h"
#include "services/store/dataset.h"

namespace etude::campaign {

/// The durable end of a campaign. Thread safety: all functions but committed() from any thread, of different episodes
/// at once.
class EpisodeSink {
 public:
  virtual ~EpisodeSink() = default;

  /// Folder of episodes/ and attempts.jsonl; the collector keeps its epoch there.
  virtual const Path& folder() const = 0;
  /// Indices that are durable already; before anything is committed.
  virtual const std::set<std::uint64_t>& committed() const = 0;
  /// Durable when it returns; of different indices. @returns for each: on error nothing of the episode is visible;
  /// kInvalidArgument, kCorrupt: the episode is at fault and is refused; anything else (disk full) is tried again
  virtual std::vector<Status> CommitGroup(std::span<const store::ArrivedEpisode> group) = 0;
  virtual Status RecordFailure(std::uint64_t index, std::uint32_t attempt, const std::string& outcome,
                               const std::string& details_json) = 0;
  /// As store::DatasetWriter::ForgetFailures: what failed until now is tried again.
  virtual Status ForgetFailures() { return {}; }
  /// Rewrites what is derived (master file, statistics). At the end.
  virtual Status WriteIndex() = 0;
  /// As much of it as costs the same however much there is; now and then.
  virtual Status WriteProgress() { return WriteIndex(); }
  /// As store::DatasetWriter::WriteFilterKey.
  virtual Status WriteFilterKey(const std::string& name, const std::set<std::uint64_t>& indices) = 0;
};

/// Mode demonstrate: a store::DatasetWriter.
Result<std::unique_ptr<EpisodeSink>> OpenDatasetSink(const Path& dataset, const CampaignSpec& spec);
/// Mode rollout: FOLDER/rollouts, a dataset of them; FOLDER/eval.jsonl, a row with every rollout, so that an
/// evaluation can be watched; and FOLDER/eval.json, the report, rewritten every few seconds and at the end.
/// @param subject  what is evaluated; of one that names no checkpoint the report that is there already has the word
/// @error kInvalidArgument: the report that is there is of another run or checkpoint, or of rollouts that are not there
Result<std::unique_ptr<EpisodeSink>> OpenEvalSink(const Path& folder, const CampaignSpec& spec,
                                                  const EvalSubject& subject = {});
/// By spec.mode.
Result<std::unique_ptr<EpisodeSink>> OpenSink(const Path& folder, const CampaignSpec& spec,
                                              const EvalSubject& subject = {});

}  // namespace etude::campaign
