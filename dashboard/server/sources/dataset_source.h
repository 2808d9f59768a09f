// SPDX-License-Identifier: Apache-2.0
// A dataset as the dashboard shows it: rows of its episodes from its journal (commits.jsonl) or, where there is none,
// from the spec at once and from the files in the background; failed attempts; single episodes.
#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "dashboard/server/sources/catalog.h"
#include "dashboard/server/sources/files.h"
#include "services/core/thread_annotations.h"
#include "services/spec/campaign_spec.h"
#include "services/spec/shard.h"
#include "services/store/commit_journal.h"
#include "services/store/dataset.h"
#include "services/store/sampling_journal.h"

namespace etude::sources {

/// One episode in lists. What is not known yet is empty; task, target, reference and robot follow from the spec.
struct EpisodeRow {
  std::uint64_t index = 0;
  bool known = false;  ///< the rest was read, not only what follows from the spec
  std::string task, target, reference, robot, split;
  std::string outcome, instruction, worker, host;
  std::uint32_t attempt = 0;
  std::uint64_t steps = 0, frames = 0, bytes = 0, draws = 0;
  std::optional<double> t;  ///< of the commit, seconds since 1970
  std::optional<double> path_m, jerk, joint_speed;
  std::optional<std::array<double, 2>> place_m;  ///< x, y of the target at the start, world
  std::optional<double> odd;                     ///< largest robust z within its task
  std::string odd_what;
  std::optional<double> plan_s, step_s, render_s, deflate_s, send_s;
};

/// A line of attempts.jsonl.
struct AttemptRow {
  std::uint64_t index = 0, seed = 0;
  std::uint32_t attempt = 0;
  std::string outcome, reason, stage, pair, worker;
  std::string task, target, robot;  ///< follow from the spec
  std::optional<double> t, plan_s, step_s, render_s, deflate_s;
};

struct DatasetInfo {
  CampaignSpec spec;
  OrderedJson spec_json, statistics;
  std::string spec_sha256, identity;
  int schema_version = 0;
  std::int64_t content = 0;
  bool journal = false;
  bool stopped = false;  ///< its last collector was stopped before all was done
  Shard shard;           ///< of its campaign's episodes
  bool derived = false;  ///< made of other datasets: whole with what is there (services/store/edit.h)
  std::uint64_t unreadable = 0;
  std::map<std::uint64_t, std::string> unreadable_files;  ///< the first of them: index -> reason
  double updated = 0;                                     ///< newest change of its files, seconds since 1970
  std::uint64_t since = 0;  ///< when its folder was begun, seconds since 1970; 0: it does not say
};

/// How many episodes the folder is to have in the end. Of one made of others: not known.
inline std::uint64_t WantedOf(const DatasetInfo& info) { return info.shard.CountOf(info.spec.episodes); }

/// Everything at one moment; rows by index, attempts in the order of their lines. Immutable, shared by requests.
struct DatasetView {
  DatasetInfo info;
  std::vector<EpisodeRow> rows;
  std::vector<AttemptRow> failures;
  std::uint64_t known = 0;

  /// nullptr: no such episode.
  const EpisodeRow* Find(std::uint64_t index) const;
  /// Indices whose attempts are used up, as their collector counts them (services/spec/attempt_outcome.h).
  std::set<std::uint64_t> UsedUp() const;
  std::uint64_t GivenUp() const { return UsedUp().size(); }
};

/// Thread-safe.
class DatasetSource {
 public:
  /// @param settled  so long after a folder of episodes changed it is listed at each look: times of files are coarse
  explicit DatasetSource(Found found, std::chrono::milliseconds settled = std::chrono::seconds(3));

  const Found& found() const { return found_; }
  /// As it is now; files are looked at again at most twice a second. @error of the store
  Result<std::shared_ptr<const DatasetView>> View();
  /// Reads the attributes of one episode that is not known; false: none is left. Takes HDF5's lock.
  bool ReadNext();
  /// One of the last few is kept. Takes HDF5's lock. @error of the store
  Result<std::shared_ptr<const store::EpisodeRecord>> Episode(std::uint64_t index);
  /// What an episode is about, made or not: index, split, and what follows from the spec.
  EpisodeRow About(std::uint64_t index);
  /// Names of the dataset's filter keys (filters.json), and the episodes of one. A small file, read each time.
  std::vector<std::string> Keys() const;
  /// @error kNotFound; kCorrupt, kUnavailable: the file cannot be read
  Result<std::set<std::uint64_t>> EpisodesOfKey(const std::string& key) const;

 private:
  Status Refresh() ETUDE_REQUIRES(mutex_);
  Status ReadSpec() ETUDE_REQUIRES(mutex_);
  void ReadCommits() ETUDE_REQUIRES(mutex_);
  void ReadFailures() ETUDE_REQUIRES(mutex_);
  void ReadEnd() ETUDE_REQUIRES(mutex_);
  Status ListEpisodes() ETUDE_REQUIRES(mutex_);
  EpisodeRow RowFromSpec(std::uint64_t index) ETUDE_REQUIRES(mutex_);
  void TakePlan(AttemptRow& row) ETUDE_REQUIRES(mutex_);  ///< what its plan says
  void ForgetUnreadable() ETUDE_REQUIRES(mutex_);
  std::shared_ptr<const DatasetView> Build() ETUDE_REQUIRES(mutex_);

  struct Recent {
    std::uint64_t index = 0;
    FileStamp stamp;
    std::shared_ptr<const store::EpisodeRecord> record;
  };

  const Found found_;
  const std::chrono::milliseconds settled_;
  mutable Mutex mutex_;
  MonotonicClock::time_point refreshed_ ETUDE_GUARDED_BY(mutex_){};
  std::optional<store::DatasetReader> reader_ ETUDE_GUARDED_BY(mutex_);
  std::optional<store::SamplingJournal> sampling_ ETUDE_GUARDED_BY(mutex_);
  FileStamp spec_stamp_ ETUDE_GUARDED_BY(mutex_), sampling_stamp_ ETUDE_GUARDED_BY(mutex_),
      collector_stamp_ ETUDE_GUARDED_BY(mutex_);
  DatasetInfo info_ ETUDE_GUARDED_BY(mutex_);
  store::CommitTail commits_ ETUDE_GUARDED_BY(mutex_);
  FileStamp commits_stamp_ ETUDE_GUARDED_BY(mutex_);
  JsonLines attempts_ ETUDE_GUARDED_BY(mutex_);
  std::vector<std::filesystem::file_time_type> folder_times_ ETUDE_GUARDED_BY(mutex_);
  MonotonicClock::time_point folders_changed_ ETUDE_GUARDED_BY(mutex_){};
  std::map<std::uint64_t, EpisodeRow> rows_ ETUDE_GUARDED_BY(mutex_);
  std::map<std::uint64_t, EpisodeRow> told_ ETUDE_GUARDED_BY(mutex_);  // by the journal, of files not seen yet
  std::vector<AttemptRow> failures_ ETUDE_GUARDED_BY(mutex_);
  std::shared_ptr<const DatasetView> view_ ETUDE_GUARDED_BY(mutex_);
  bool changed_ ETUDE_GUARDED_BY(mutex_) = true;
  std::list<Recent> recent_ ETUDE_GUARDED_BY(mutex_);
  std::map<std::uint64_t, MonotonicClock::time_point> again_at_ ETUDE_GUARDED_BY(mutex_);
  std::map<std::uint64_t, FileStamp> unreadable_stamps_ ETUDE_GUARDED_BY(mutex_);  // of all that cannot be read
};

/// SplitOf; "" for a spec that has no split, as only a damaged one does.
std::string SplitOrNone(const CampaignSpec& spec, std::uint64_t index);

/// Sets odd and odd_what: for each of steps, path, jerk and joint speed |x - median| / (1.4826 MAD) within the task;
/// the largest counts. Tasks with fewer than eight known episodes have none.
void MarkOdd(std::vector<EpisodeRow>& rows);

}  // namespace etude::sources
