// SPDX-License-Identifier: Apache-2.0
// A training run from its folder: series of metrics.jsonl, curriculum, config and the headers of its checkpoints.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dashboard/server/sources/catalog.h"
#include "dashboard/server/sources/files.h"
#include "services/core/thread_annotations.h"

namespace etude::sources {

/// One figure over training, in the order of its lines; a null in the file is a NaN here.
struct Series {
  std::vector<double> step, time, elapsed, value;
  std::uint64_t nulls = 0;
};

/// How a run says that it ended ("end" lines).
struct RunEnd {
  std::string cause;  ///< finished | stopped | failed
  std::optional<std::uint64_t> step;
  std::optional<double> t;
};

/// Lines of metrics.jsonl as series by "KIND/NAME". Where the step goes back, a run was resumed from a checkpoint: what
/// the life before it had from there on is superseded and goes. Not thread-safe.
class MetricsTable {
 public:
  void Take(const OrderedJson& line);
  void Clear() { *this = MetricsTable(); }

  struct Life {
    std::uint64_t from_step = 0;
    std::optional<double> t;
  };
  const std::map<std::string, Series>& series() const { return series_; }
  const std::vector<Life>& lives() const { return lives_; }
  const std::optional<RunEnd>& end() const { return end_; }
  /// Of the last train or valid line of the life under way; 0 before the first.
  std::uint64_t step() const { return step_; }
  /// Newest value of a series; nullopt: none, or null.
  std::optional<double> Last(const std::string& key) const;
  std::vector<OrderedJson> LinesAfter(std::uint64_t step, std::size_t most) const;

 private:
  void Resume(std::uint64_t step);

  std::map<std::string, Series> series_;
  std::vector<Life> lives_;
  std::vector<OrderedJson> recent_;  // the last lines
  std::optional<RunEnd> end_;
  std::uint64_t step_ = 0;
};

/// Buckets of equal width over x; one without values is left out. Values that are not finite are an entry of their own,
/// NaN, so that they are neither passed over nor hide those that are.
struct Buckets {
  std::vector<double> x, min, max, last;
  std::vector<std::size_t> index;  ///< of the values that `last` has
};
/// @param points  buckets at most, each of one or two entries; when the range has no more values than that, each is its
/// own bucket and exact
Buckets Bucketed(const std::vector<double>& x, const std::vector<double>& value, double from, double to,
                 std::size_t points);

/// A checkpoint file's header; its weights are never read.
struct CheckpointHeader {
  std::string file;
  FileStamp stamp;
  std::map<std::string, std::string> metadata;
  std::map<std::string, std::uint64_t> parameters;  ///< numbers by part: "image", "LANG", ...
  std::string error;                                ///< why it could not be read
  std::vector<std::string> channels;                ///< links to it: latest, best
  std::string sha256;                               ///< of the whole file; "": not known yet
  bool operator==(const CheckpointHeader&) const = default;
};
/// @error kNotFound, kCorrupt. Reads at most `header_bytes`.
Result<CheckpointHeader> ReadCheckpointHeader(const Path& folder, const std::string& file,
                                              std::uint64_t header_bytes = 4 << 20);

struct RunView {
  OrderedJson config;  ///< config.yaml; null when it cannot be read
  std::string identity;
  std::uint64_t since = 0;  ///< when its folder was begun, seconds since 1970; 0: it does not say
  MetricsTable metrics;
  bool torn = false;
  std::vector<OrderedJson> curriculum;
  std::vector<CheckpointHeader> checkpoints;  ///< newest first
  double updated = 0;                         ///< seconds since 1970
};

/// Thread-safe.
class RunSource {
 public:
  explicit RunSource(Found found);
  const Found& found() const { return found_; }
  /// As it is now; files are looked at again at most twice a second.
  Result<std::shared_ptr<const RunView>> View();
  /// Hashes one checkpoint whose hash is not known; false: none is left. 5 to 40 MB.
  bool HashNext();

 private:
  void Refresh() ETUDE_REQUIRES(mutex_);
  void ReadCheckpoints() ETUDE_REQUIRES(mutex_);

  const Found found_;
  Mutex mutex_;
  MonotonicClock::time_point refreshed_ ETUDE_GUARDED_BY(mutex_){};
  JsonLines metrics_file_ ETUDE_GUARDED_BY(mutex_), curriculum_file_ ETUDE_GUARDED_BY(mutex_);
  FileStamp config_stamp_ ETUDE_GUARDED_BY(mutex_);
  RunView now_ ETUDE_GUARDED_BY(mutex_);
  std::shared_ptr<const RunView> view_ ETUDE_GUARDED_BY(mutex_);
  bool changed_ ETUDE_GUARDED_BY(mutex_) = true;
  std::map<std::string, std::string> hashes_ ETUDE_GUARDED_BY(mutex_);  // by FileStamp::tag
};

}  // namespace etude::sources
