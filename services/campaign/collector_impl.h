// SPDX-License-Identifier: Apache-2.0
// What Collector's threads share. Run's own receives episodes, a few commit them in groups (collector_commit.cc);
// `control` answers requests (collector_requests.cc), reports and heartbeats (collector_attempts.cc), so that a slow
// disk never makes a lease expire; `indexer` writes what is derived. Internal to services/campaign.
#pragma once

#include <atomic>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <thread>

#include "services/bus/addressed_writers.h"
#include "services/bus/blob_transfer.h"
#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/campaign/collector.h"
#include "services/campaign/fingerprint.h"
#include "services/campaign/lease_table.h"
#include "services/campaign/recheck_table.h"
#include "services/core/stop.h"
#include "services/core/thread_annotations.h"
#include "services/episode/codec.h"
#include "services/store/sampling_journal.h"

namespace etude::campaign {

// What a collector says and hears.
struct CollectorTopics {
  bus::Writer<bus::CampaignAnnouncement> announcements;
  bus::AddressedWriters<bus::Lease> leases;
  bus::Writer<bus::CampaignStatus> statuses;
  bus::Reader<bus::WorkRequest> requests;
  bus::Reader<bus::AttemptReport> reports;
  bus::Reader<bus::WorkerStatus> heartbeats;
  bus::Reader<bus::ValidationErrors> errors;
  bus::Reader<bus::CampaignControl> controls;
  bus::BlobReceiver episodes;  // Run's thread receives, those that commit acknowledge

  static Result<CollectorTopics> Open(const bus::Participant& participant, const bus::Owner& owner,
                                      const CollectorOptions& options);
};

struct Collector::Impl {
  using Time = MonotonicClock::time_point;

  CampaignSpec spec;
  std::string spec_sha256;
  CollectorOptions options;
  std::string id;
  std::uint64_t epoch = 0;

  // control thread (and Open)
  bus::Announcement presence;
  std::set<std::string> greeted = {};       // workers whose program was logged
  std::optional<std::string> files_sha256;  // of the first worker
  std::optional<Fingerprint> fingerprint;   // of the first worker that says one
  CollectorTopics topics;
  std::string run_id;                    // whose errors count; "": of the first that speaks
  std::optional<SamplingEntry> wanted;   // by the newest errors; holds from no index yet
  std::string refusal;                   // what was said last of errors that were not taken
  std::unique_ptr<EpisodeSink> sink;     // safe for all of them
  std::atomic<bool> index_dirty{true};   // the index lacks what is committed or has failed
  std::atomic<bool> index_whole{false};  // nothing was left for the end when it was written last

  Time looked = MonotonicClock::now();  // of the control thread: when messages were taken last

  std::atomic<bool> stop{false};
  std::atomic<bool> finished{false};  // all is committed that will be, control may end

  mutable Mutex mutex;
  Time started ETUDE_GUARDED_BY(mutex) = MonotonicClock::now();
  LeaseTable table ETUDE_GUARDED_BY(mutex);
  CollectorProgress counters ETUDE_GUARDED_BY(mutex);  // failures, stale_results, duplicates, refused, error
  std::uint64_t failed_attempts ETUDE_GUARDED_BY(mutex) = 0;
  RecheckTable rechecks ETUDE_GUARDED_BY(mutex);
  bool said_unchecked ETUDE_GUARDED_BY(mutex) = false;
  bool all_done ETUDE_GUARDED_BY(mutex) = false;  // AllDone was true once
  // of the workers in `heard` that have asked: of the address where they read the answer, which under security is what
  // their identity names, and not what they say of themselves
  std::map<std::string, std::string> hosts ETUDE_GUARDED_BY(mutex);
  struct LeasedTo {
    std::string address, before;  // who asked last in a worker's name, and whom it took that over from
  };
  std::map<std::string, LeasedTo> leased_to ETUDE_GUARDED_BY(mutex);
  std::map<std::string, Time> heard ETUDE_GUARDED_BY(mutex);  // worker -> last sign of life
  std::set<std::string> told_apart ETUDE_GUARDED_BY(mutex);   // workers' names that two have, as was said
  std::set<std::string> dismissed ETUDE_GUARDED_BY(mutex);    // workers that were told kDone
  std::deque<Time> commits ETUDE_GUARDED_BY(mutex);           // of the last minute
  std::optional<Error> ended_by ETUDE_GUARDED_BY(mutex);      // e.g. another collector of this id has the better right
  struct Motion {                                             // of a worker's attempt, by its heartbeats
    std::uint64_t index = 0, mark = 0;
    std::string phase, stage;
    std::uint32_t step = 0;
    Time since{};  // of the last change
    bool SameAs(const bus::WorkerStatus& status) const {
      return mark == status.token && step == status.step && phase == status.phase && stage == status.stage;
    }
  };
  std::map<std::string, Motion> motions ETUDE_GUARDED_BY(mutex);  // of workers that hold a lease
  // of workers that beat and hold nothing: since when they ask for nothing
  std::map<std::string, Time> idle ETUDE_GUARDED_BY(mutex);
  struct Deadly {  // an attempt that has failed because it ended workers, and is not on disk yet
    std::uint64_t index = 0;
    std::uint32_t attempt = 0;
    std::string how;  // it ended the last one
  };
  std::vector<std::string> silent ETUDE_GUARDED_BY(mutex);  // for TakeSilent
  struct Unfit {
    int in_a_row = 0;
    std::string reason;  // of the last one
  };
  std::map<std::string, Unfit> unfit ETUDE_GUARDED_BY(mutex);     // by worker
  std::optional<Time> policy_away_since ETUDE_GUARDED_BY(mutex);  // the first of the rollouts that got no answer
  std::string policy_error ETUDE_GUARDED_BY(mutex);               // what the last of them says
  std::string journal_error ETUDE_GUARDED_BY(mutex);       // the sampling journal cannot be written: leasing waits
  enum class Leasing { kOn, kDraining, kPaused };          // kDraining: off, and some leases are still out
  Leasing leasing ETUDE_GUARDED_BY(mutex) = Leasing::kOn;  // as `etude campaign` asked for; a restart forgets it
  std::string control_id ETUDE_GUARDED_BY(mutex);          // of the last request that was taken
  std::string control_refusal ETUDE_GUARDED_BY(mutex);     // why it was not followed
  std::map<std::string, std::string> answered_controls ETUDE_GUARDED_BY(mutex);  // refusal by id, of the last ones

  // Indices that are made durable now, and what came for them meanwhile: it is judged when the first one is settled.
  std::map<std::uint64_t, std::vector<bus::ReceivedBlob>> committing ETUDE_GUARDED_BY(mutex);
  std::map<std::thread::id, std::string> disk_errors ETUDE_GUARDED_BY(mutex);  // of the commit threads that wait

  Mutex queue_mutex;                                                  // never taken while `mutex` is held
  ConditionVariable queue_changed, over;                              // the latter: closing, or a key is wished
  std::deque<bus::ReceivedBlob> queue ETUDE_GUARDED_BY(queue_mutex);  // its bound is the receiver's max_memory
  bool closing ETUDE_GUARDED_BY(queue_mutex) = false;                 // what is still queued is sent again elsewhere
  struct KeyWish {
    std::string control_id, name;
    std::string episodes;  // as they were sent: parsed where there is time for it
  };
  std::deque<KeyWish> key_wishes ETUDE_GUARDED_BY(queue_mutex);  // the first one is being written
  std::atomic<bool> answered{false};                             // a wish: the next status says so

  mutable Mutex journal_mutex;  // never taken while `mutex` is held
  store::SamplingJournal journal ETUDE_GUARDED_BY(journal_mutex);

  bool Stopping() const { return stop.load() || StopRequested(); }
  bool Complete() ETUDE_EXCLUDES(mutex);
  std::optional<Error> EndedBy() ETUDE_EXCLUDES(mutex);
  CollectorProgress Snapshot() ETUDE_REQUIRES(mutex);
  void Announce(bool complete);
  /// What throws on one of the collector's threads ends the collector with words, not the process.
  void Guard(const char* thread, const std::function<void()>& work) ETUDE_EXCLUDES(mutex);

  // control thread (collector_control.cc)
  void Control();
  void GiveWayToSuccessor();
  void TakeMessages();
  bool OnControl(const bus::CampaignControl& control);
  std::string Follow(bus::ControlAction action) ETUDE_REQUIRES(mutex);
  bool OnKeyWish(const bus::CampaignControl& control) ETUDE_EXCLUDES(mutex) ETUDE_EXCLUDES(queue_mutex);
  std::string AddWish(KeyWish wish) ETUDE_EXCLUDES(queue_mutex);
  std::string StateNow() ETUDE_REQUIRES(mutex);
  void PublishStatus();

  // who may work, and on what (collector_requests.cc)
  void OnRequest(const bus::WorkRequest& request);
  void Greet(const bus::WorkRequest& request);
  bus::Lease Answer(const bus::WorkRequest& request);
  Assignment Assign(const bus::WorkRequest& request);
  bool HoldsElsewhere(const bus::WorkRequest& request) ETUDE_REQUIRES(mutex);
  std::optional<std::string> WhyRefused(const bus::WorkRequest& request);
  std::optional<std::string> WhyUnlike(const bus::WorkRequest& request);
  std::optional<std::string> WhySentAway(const std::string& worker) const ETUDE_EXCLUDES(mutex);
  std::string WhileNothingIsCommitted() const ETUDE_EXCLUDES(mutex);

  // what becomes of attempts at work (collector_attempts.cc)
  void HearAgain(const std::string& worker) ETUDE_REQUIRES(mutex);
  void OnReport(const bus::AttemptReport& report);
  void OnHeartbeat(const bus::WorkerStatus& status);
  bool OnReleased(const bus::AttemptReport& report) ETUDE_REQUIRES(mutex);
  void OnPolicyError(const bus::AttemptReport& report) ETUDE_REQUIRES(mutex);
  void ForgiveStandstill() ETUDE_EXCLUDES(mutex);
  std::vector<Deadly> EndSilent() ETUDE_EXCLUDES(mutex);
  std::optional<Deadly> EndIfStill(const std::string& worker, Motion& motion, Time now) ETUDE_REQUIRES(mutex);
  std::optional<Deadly> Revoke(const std::string& worker, bool by_attempt, const std::string& how)
      ETUDE_REQUIRES(mutex);
  void CountKilled() ETUDE_REQUIRES(mutex);
  void Record(std::uint64_t index, std::uint32_t attempt, const std::string& outcome, const std::string& details)
      ETUDE_EXCLUDES(mutex);
  void Record(const Deadly& failed) ETUDE_EXCLUDES(mutex);

  // weights by validation errors (collector_sampling.cc)
  void OnErrors(const bus::ValidationErrors& message);
  Result<SamplingEntry> WantedBy(const bus::ValidationErrors& message);
  bool Reweight();
  SamplingWeights WeightsAt(std::uint64_t index) const ETUDE_EXCLUDES(journal_mutex);

  // what is made again on another host (collector_recheck.cc)
  std::optional<Assignment> MakeAgain(const bus::WorkRequest& request) ETUDE_REQUIRES(mutex);
  std::string HostOf(const std::string& worker) const ETUDE_REQUIRES(mutex);
  bool AllDone() ETUDE_REQUIRES(mutex);
  void SayUnchecked(bool at_end) ETUDE_EXCLUDES(mutex);
  std::optional<bus::Verdict> JudgeAgain(const bus::BlobManifest& manifest) ETUDE_EXCLUDES(mutex);
  bool OnReportAgain(const bus::AttemptReport& report, const std::string& outcome) ETUDE_EXCLUDES(mutex);
  std::string TellMismatch(const RecheckTable::Lease& lease, const char* what, const std::string& found)
      ETUDE_EXCLUDES(mutex);

  // receiving thread
  void ReceiveUntilOver();
  void Enqueue(bus::ReceivedBlob blob) ETUDE_EXCLUDES(queue_mutex);
  void Close() ETUDE_EXCLUDES(queue_mutex);
  void Drain();

  // commit threads
  struct Claim;
  std::size_t CommitThreads() const;
  void CommitLoop();
  std::vector<bus::ReceivedBlob> NextBatch() ETUDE_EXCLUDES(queue_mutex);
  void OnEpisode(bus::ReceivedBlob blob, std::vector<Claim>& claims);
  Status CheckEpisode(const Episode& episode) const;
  std::optional<bus::Verdict> Judge(bus::ReceivedBlob& blob, const Result<EpisodeView>& view);
  void CountUnfit(const bus::BlobManifest& manifest, const std::string& reason) ETUDE_REQUIRES(mutex);
  void CountRefused() ETUDE_EXCLUDES(mutex);
  void CommitUntilDurable(std::vector<Claim> claims);
  bool SettleOrKeep(std::vector<Claim>& claims, const std::vector<Status>& statuses);
  void TellOfDisk(const std::string& error) ETUDE_EXCLUDES(mutex);
  void Settle(const Claim& claim, const std::optional<bus::Verdict>& verdict);
  void Acknowledge(const bus::BlobManifest& manifest, const bus::Verdict& verdict);

  // indexer
  void IndexNowAndThen();
  bool WaitForIndex(Time due) ETUDE_EXCLUDES(queue_mutex);
  std::optional<KeyWish> FirstWish() ETUDE_EXCLUDES(queue_mutex);
  Status WriteKey(const KeyWish& wish, std::size_t& count);
  void WriteWishedKeys() ETUDE_EXCLUDES(mutex) ETUDE_EXCLUDES(queue_mutex);
  Status WriteIndex(bool at_end);
  void TryIndex(bool at_end);
  Status WriteLastIndex() ETUDE_EXCLUDES(mutex);
};

/// SHA-256 of a blob's bytes, hex, as its manifest has it: the receiver found it to be that of the bytes.
std::string DigestOf(const bus::BlobManifest& manifest);

/// A worker that has not been heard for this long is not counted as present.
inline constexpr std::chrono::seconds kPresence{5};
/// Commits looked at for the rate.
inline constexpr std::chrono::seconds kRateWindow{60};

}  // namespace etude::campaign
