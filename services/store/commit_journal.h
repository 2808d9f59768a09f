// SPDX-License-Identifier: Apache-2.0
// DATASET/commits.jsonl: a line for each committed episode with what a list, a filter or a histogram wants to know of
// it, so that nobody opens ten thousand files to draw a page. It is a cache of what the episode files hold, with who
// made them and how long it took: the files decide what is committed, `DatasetWriter` brings the journal in line with
// them, and a reader that finds a line missing has lost nothing.
//
//   CommitTail tail("out/data");
//   tail.Refresh([&] { rows.clear(); }, [&](const CommitRow& row) { rows[row.index] = row; });
//   tail.Refresh(...);                                 // again later: reads only what was added
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_set>

#include "services/core/file.h"
#include "services/core/result.h"
#include "services/episode/attempt_details.h"
#include "services/episode/attempt_times.h"
#include "services/episode/episode.h"

namespace etude::store {

/// Who made an episode and how long it took: nothing of it enters the episode's bytes. "" and 0: not known.
struct CommitFacts {
  std::string worker, host;
  std::string fingerprint;  ///< short hash of what the host's bytes depend on; "": not said
  AttemptTimes timings;
};

/// One line of the journal.
struct CommitRow {
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  double t = 0;  ///< of the commit, seconds since 1970
  CommitFacts facts;
  std::uint64_t bytes = 0;  ///< of the file
  std::uint64_t steps = 0, frames = 0;
  std::string outcome, robot, task, target, reference, instruction;
  double path_m = 0;       ///< way of the hand
  double jerk = 0;         ///< of the hand, m/s^3: root mean square of third differences over 0.04 s
  double joint_speed = 0;  ///< of the arm, largest, rad/s
  std::optional<std::array<double, 2>> place_m;  ///< x, y of the target at the start, world; lines of an older program
                                                 ///< are without it and without joint_speed
  std::uint64_t draws = 0;                       ///< of starts, until one was taken; 0: not said
  // for the dataset's statistics; lines of an older program are without them, and `counted` is then false
  bool counted = false;
  bool success = false;
  std::uint64_t samples = 0;  ///< at the rate of images
  SceneTally scene;
  PlanTally planned;
};

/// What the episode itself says; `t` and `facts` are left as they are by default.
/// @param frames  of all cameras   @param bytes  of its file
CommitRow RowOf(const Episode& episode, std::uint64_t frames, std::uint64_t bytes);

/// A line without its end: {"index", "attempt", "t", "worker", "host", "fingerprint", "bytes", "steps", "frames",
/// "outcome", "robot", "task", "target", "reference", "instruction", "timings": {...}, "path_m", "jerk", "joint_speed",
/// "place_m": [x, y], "draws"} and, when it is counted, "success", "samples", "scene", "planned".
std::string LineOf(const CommitRow& row);
/// Keys that are missing keep their defaults, others are ignored. @error kCorrupt: not JSON, without an index, or with
/// a value of another kind
Result<CommitRow> ParseCommitLine(std::string_view line);

/// Calls `take` with each line of an episode that is there, in their order, as CommitJournal::Open does: one of a file
/// of another size, or that comes again, is none. The journal stays as it is; where there is none, it has no lines.
/// @param bytes_of  size of every committed episode's file
void ForEachCommit(const Path& dataset, const std::map<std::uint64_t, std::uint64_t>& bytes_of,
                   const std::function<void(const CommitRow&)>& take);

/// The writing end, of who holds the dataset's lock. Not thread-safe.
class CommitJournal {
 public:
  /// Brings the journal in line with the files: what is torn, comes twice (the first counts), or is of a file that is
  /// not there or has another size is dropped, by rename.
  /// @param bytes_of  size of every committed episode's file
  /// @param found     called with each line of an episode that is there, in their order   @error kUnavailable
  static Result<CommitJournal> Open(const Path& dataset, const std::map<std::uint64_t, std::uint64_t>& bytes_of,
                                    const std::function<void(const CommitRow&)>& found = nullptr);

  bool Contains(std::uint64_t index) const { return rows_.contains(index); }
  /// One write(2); durable after a Sync (Duplicate). On error the journal is as before.
  Status Append(const CommitRow& row);
  /// What makes it durable by its Sync, beside whoever appends.
  Result<LineAppender> Duplicate() const { return lines_.Duplicate(); }

 private:
  explicit CommitJournal(LineAppender lines) : lines_(std::move(lines)) {}
  LineAppender lines_;
  std::unordered_set<std::uint64_t> rows_;  // indices
};

/// The reading end, also while it grows: each line once. Memory has a bound, whoever wrote the file: a text beyond
/// kLongestText bytes becomes "…", and what is longer than a line of ours is passed over. One thread at a time.
class CommitTail {
 public:
  static constexpr std::size_t kLongestText = 1'000;

  explicit CommitTail(const Path& dataset);

  /// Calls `take` with each line that came since the last call, in their order: of an index that comes again the later
  /// one counts. What is not understood is passed over; a last line without its end waits for the next call.
  /// @param reset  called first when the file was replaced or has gone, and before the first lines of all: what was
  /// taken so far counts no more
  /// @returns whether anything changed. @error kUnavailable: it cannot be read now; what was taken stands, and the next
  /// call goes on behind it
  Result<bool> Refresh(const std::function<void()>& reset, const std::function<void(const CommitRow&)>& take);

 private:
  Status TakeLines(int file, std::uint64_t length, const std::function<void(const CommitRow&)>& take);

  Path file_;
  std::uint64_t device_ = 0, inode_ = 0, offset_ = 0;  // of the file that was read, and how far
  std::string before_;                                 // what stands before `offset_`
};

}  // namespace etude::store
