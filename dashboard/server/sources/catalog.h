// SPDX-License-Identifier: Apache-2.0
// What lies below the folders that the gateway was given: datasets, runs and evaluations, told by their files. Every
// name in a request is looked up here and never joined into a path.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/core/thread_annotations.h"

namespace etude::sources {

enum class Kind : std::uint8_t { kDataset, kRun, kEval };
std::string ToString(Kind kind);  ///< "dataset", "run", "eval"

struct Found {
  Kind kind = Kind::kDataset;
  /// The folder below its root, with '.' between its parts: "quickstart.run.base"; behind that a hash of what it is
  /// called where it would have the id of another: "lab.my_data-1c2d3e4f" of "lab/my data". Unique.
  std::string id;
  std::string name;    ///< the folder's own
  Path folder;         ///< absolute, without links
  std::string shown;   ///< for people: "quickstart/run/base"
  std::string eval;    ///< a dataset of rollouts: the evaluation's id; else ""
  double changed = 0;  ///< newest change of its files at the last look, seconds since 1970
};

/// Thread-safe.
class Catalog {
 public:
  /// @param roots     folders; one that is itself a dataset, a run or an evaluation is found as such
  /// @param left_out  a folder below a root that is not looked into; empty: none
  /// @param most_entries  that are looked at, of one root
  explicit Catalog(std::vector<Path> roots, const Path& left_out = {}, std::size_t most_entries = 20'000);

  /// What is there, looked for again at most every three seconds; in order of kind and id.
  std::shared_ptr<const std::vector<Found>> List();
  /// Those of a kind that changed last, at most `most`, newest first: what is looked at all the time has a bound.
  struct Newest {
    std::vector<Found> found;
    std::size_t more = 0;  ///< that are left out
  };
  /// Which datasets: those of demonstrations, of an evaluation's rollouts, or both.
  enum class Role : std::uint8_t { kAny, kDemonstrations, kRollouts };
  Newest NewestOf(Kind kind, std::size_t most, Role role = Role::kAny);
  /// The newest datasets that are not an evaluation's rollouts.
  std::vector<Found> Demonstrations(std::size_t most) {
    return NewestOf(Kind::kDataset, most, Role::kDemonstrations).found;
  }
  /// @error kNotFound: names what there is
  Result<Found> Find(Kind kind, const std::string& id);
  const std::vector<Path>& roots() const { return roots_; }
  /// Files that end in .log, directly in folders named logs or in what was found: (id, absolute folder, file).
  struct LogFile {
    std::string id;
    Path folder, file;
  };
  std::shared_ptr<const std::vector<LogFile>> Logs();
  /// Roots with more in them than is looked at: what lies in the rest was not found.
  std::vector<Path> NotSearched();

 private:
  void Scan() ETUDE_REQUIRES(mutex_);

  const std::vector<Path> roots_;
  const std::vector<std::string> names_;  // of the roots, for people
  const Path left_out_;
  const std::size_t most_entries_;
  Mutex mutex_;
  std::shared_ptr<const std::vector<Found>> found_ ETUDE_GUARDED_BY(mutex_);
  std::shared_ptr<const std::vector<LogFile>> logs_ ETUDE_GUARDED_BY(mutex_);
  std::vector<Path> not_searched_ ETUDE_GUARDED_BY(mutex_);
  MonotonicClock::time_point scanned_ ETUDE_GUARDED_BY(mutex_){};
};

}  // namespace etude::sources
