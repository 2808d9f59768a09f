// SPDX-License-Identifier: Apache-2.0
// The owner of a campaign: leases work, checks and commits episodes, acknowledges what is durable.
//
//   ETUDE_ASSIGN_OR_RETURN(auto collector, Collector::Open(participant, spec, "out/data"));
//   ETUDE_RETURN_IF_ERROR(collector.Run());   // or on a thread of its own, as the trainer does
//
// Promises: an episode is acknowledged only after it is durable; an index is committed once; a collector
// that is killed and started again on the same folder continues, with larger fencing tokens. The campaign is its
// folder, known by the id that was minted with it: another folder's campaign of the same name is another one, and a
// second collector of the same id ends one of the two. Where the spec has adaptive_sampling, weights that follow from a
// trainer's validation errors hold from an index on that nobody was leased before, once they are durable in the
// folder's sampling journal: a restart, or the same spec and journal elsewhere, make the same episodes.
//
// With CollectorOptions::shard it is one of several that share a campaign of one name and spec: each has its own
// folder, id, tokens and attempts, and every K-th episode. Two of one shard, or of different counts, are refused like
// two of one id.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "services/bus/participant.h"
#include "services/campaign/sink.h"
#include "services/core/file.h"
#include "services/core/identity.h"
#include "services/core/result.h"
#include "services/spec/campaign_spec.h"
#include "services/spec/content_version.h"
#include "services/spec/shard.h"

namespace etude::campaign {

struct CollectorOptions {
  std::chrono::milliseconds lease{10'000};  ///< a worker silent for this long loses its work
  std::chrono::milliseconds status_every{1'000};
  std::chrono::milliseconds index_every{
      30'000};  ///< statistics, and dataset.hdf5 when it is due (DatasetWriter::WriteProgress)
  std::chrono::milliseconds retry_commit{1'000};  ///< after a full disk
  std::chrono::milliseconds drain{2'000};         ///< at the end, to tell workers that it is done
  /// The same, when some that worked in the last minute are not to be heard: a link is down, or they were killed.
  std::chrono::milliseconds away{60'000};
  int unfit_budget = 3;  ///< episodes in a row that do not fit; then their worker is sent away
  std::chrono::milliseconds policy_patience{300'000};  ///< rollouts without one answer; then the evaluation fails
  std::chrono::milliseconds ready{600'000};            ///< for a worker that beats to ask for the first time, at least
  std::uint64_t max_in_flight = 16'384;                ///< leases worked on at once; as many may wait
  std::size_t commit_threads = 0;                      ///< 0: as many as cores, at most 4
  /// Bytes of episodes that came and are not durable yet; one alone may be larger. Senders beyond it wait, so that a
  /// stalled or full disk costs no more memory than this.
  std::uint64_t max_memory = 512ull << 20;
  Shard shard;                              ///< of the campaign's episodes those that this collector has
  Claim claim = Claim::kRefuse;             ///< when the folder's id is live elsewhere
  std::string policy_id;                    ///< rollouts ask this run's policy; "": whoever serves its name
  std::string run_id;                       ///< whose validation errors count; "": of the first run that speaks
  EvalSubject subject;                      ///< in mode rollout: what is evaluated, for the report
  std::uint32_t content = kContentVersion;  ///< of the episodes: workers of another number are refused
};

/// A snapshot of how far a campaign is.
struct CollectorProgress {
  std::uint64_t committed = 0, total = 0, given_up = 0;  ///< of a shard: of its own
  std::uint64_t attempts = 0;  ///< committed + failed, this and earlier runs; without answers that never came
  std::map<std::string, std::uint64_t> failures;  ///< typed reason -> count
  std::uint64_t lost_leases = 0;                  ///< workers that died or fell silent
  std::uint64_t stale_results = 0;                ///< refused: an old fencing token, or not its worker's
  std::uint64_t duplicates = 0;
  std::uint64_t refused = 0;          ///< episodes that did not fit
  std::uint64_t rechecked = 0;        ///< made again on another host since the start (CampaignSpec::recheck)
  std::uint64_t mismatched = 0;       ///< with other bytes there than committed, this and earlier runs
  std::uint64_t reweighted = 0;       ///< entries of the sampling journal, this and earlier runs
  std::uint64_t reweighted_from = 0;  ///< episode from which on the newest of them holds
  std::uint64_t refused_errors = 0;   ///< validation errors that were not taken
  std::uint32_t workers = 0;          ///< heard within the last seconds
  double episodes_per_minute = 0;     ///< over the last minute
  double eta_s = 0;                   ///< 0: unknown
  double elapsed_s = 0;
  std::string error;  ///< e.g. disk full: committing waits
  bool complete = false;
};

/// Thread safety: Run() from one thread; everything else from any.
class Collector {
 public:
  /// Opens (or resumes) the folder by spec.mode and joins the bus under the campaign's name and the folder's id.
  /// @error of the store (kInvalidArgument: made from another spec; kUnavailable: locked, disk) or the bus;
  /// kUnavailable when the folder's id, or the shard, is live elsewhere on the domain (see CollectorOptions::claim);
  /// kInvalidArgument: a shard of a rollout, or of a campaign with adaptive_sampling, or not the folder's.
  static Result<Collector> Open(const bus::Participant& participant, const CampaignSpec& spec, const Path& folder,
                                const CollectorOptions& options = {});
  /// With a sink of the caller's own.
  static Result<Collector> Open(const bus::Participant& participant, const CampaignSpec& spec,
                                std::unique_ptr<EpisodeSink> sink, const CollectorOptions& options = {});
  Collector(Collector&&) noexcept;
  Collector& operator=(Collector&&) noexcept;
  ~Collector();

  /// Blocks until every index is committed or given up, Stop() is called or the process is asked to stop.
  /// Always leaves the folder complete in itself (index written). A stop is no error.
  /// @error kUnavailable: another collector of the same id appeared, and has the better right to it; in mode rollout:
  /// the policy has answered nobody for `policy_patience`. What is committed stays, and no rollout is given up for it.
  Status Run();
  void Stop();

  /// Of the campaign: NAME@ID is what a worker joins.
  const std::string& id() const;
  CollectorProgress progress() const;
  /// Workers whose leases were taken since the last call: they did not beat, or beat and did not move for
  /// the spec's stall_timeout_s. Whoever started them should end them and start others.
  std::vector<std::string> TakeSilent();
  /// The caller knows that `worker` is dead (it was its child), and its exit code (Process::Poll): its lease is revoked
  /// and free at once. An attempt that has crashed several workers has failed.
  void Revoke(const std::string& worker, int exit_code);

 private:
  struct Impl;
  explicit Collector(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::campaign
