// SPDX-License-Identifier: Apache-2.0
// An evaluation from its folder: the report, its rows, its videos.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "dashboard/server/sources/catalog.h"
#include "dashboard/server/sources/files.h"
#include "services/core/thread_annotations.h"

namespace etude::sources {

struct EvalView {
  OrderedJson report;               ///< eval.json; an empty object before the first
  std::vector<OrderedJson> rows;    ///< its per_episode, or eval.jsonl's where that has more, by index
  OrderedJson spec;                 ///< of its campaign; null when there are no rollouts yet
  std::vector<std::string> videos;  ///< names in videos/
  double updated = 0;               ///< seconds since 1970
};

/// Thread-safe.
class EvalSource {
 public:
  explicit EvalSource(Found found) : found_(std::move(found)), lines_(found_.folder / "eval.jsonl") {}
  const Found& found() const { return found_; }
  /// As it is now; files are looked at again at most once a second. @error kCorrupt: eval.json is no JSON
  Result<std::shared_ptr<const EvalView>> View();

 private:
  const Found found_;
  Mutex mutex_;
  MonotonicClock::time_point refreshed_ ETUDE_GUARDED_BY(mutex_){};
  FileStamp report_stamp_ ETUDE_GUARDED_BY(mutex_), spec_stamp_ ETUDE_GUARDED_BY(mutex_);
  JsonLines lines_ ETUDE_GUARDED_BY(mutex_);
  std::vector<OrderedJson> streamed_ ETUDE_GUARDED_BY(mutex_);
  OrderedJson rollouts_spec_ ETUDE_GUARDED_BY(mutex_);
  EvalView now_ ETUDE_GUARDED_BY(mutex_);
  std::shared_ptr<const EvalView> view_ ETUDE_GUARDED_BY(mutex_);
};

}  // namespace etude::sources
