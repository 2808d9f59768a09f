// SPDX-License-Identifier: Apache-2.0
// DATASET/commits.jsonl: a line for each committed episode with what a list, a filter or a histogram wants to know of
// it, so that nobody opens ten thousand files to draw a page. It is a cache of what the episode files hold, with who
// made them and how long it took: the files decide what is committed, `DatasetWriter` brings the journal in line with
// them, and a reader that finds a line missing has lost nothing.
//
//   CommitTable table("out/data");
//   table.Refresh();                                   // again later: reads only what was added
//   for (std::size_t row = 0; row < table.size(); ++row) use(table.index()[row], table.task().At(row));
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <vector>

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

/// Texts of which many are equal: one number a row. Beyond kMostWords different ones, or kLongestWord bytes, a text
/// becomes "…": memory has a bound, whoever wrote the file.
class WordColumn {
 public:
  static constexpr std::size_t kMostWords = 65'536;
  static constexpr std::size_t kLongestWord = 1'000;

  const std::string& At(std::size_t row) const { return words_[codes_[row]]; }
  const std::vector<std::uint32_t>& codes() const { return codes_; }  ///< by row, into words()
  const std::vector<std::string>& words() const { return words_; }    ///< in the order in which they came
  /// @pre row <= rows so far
  void Set(std::size_t row, const std::string& text);
  void Clear();

 private:
  std::vector<std::uint32_t> codes_;
  std::vector<std::string> words_;
  std::unordered_map<std::string, std::uint32_t> code_of_;
};

/// The reading end: the journal as columns, also while it grows. About 200 bytes a row. One thread at a time.
class CommitTable {
 public:
  explicit CommitTable(const Path& dataset, std::size_t most_rows = 2'000'000);

  /// Reads what was added since; all of it again when the file was replaced (then `generation` grows). A last line
  /// without its end waits for the next call. No file: no rows.
  /// @returns true when something changed. @error kUnavailable: it cannot be read now; the rows stay.
  Result<bool> Refresh();

  std::size_t size() const { return index_.size(); }
  std::uint64_t generation() const { return generation_; }
  std::uint64_t unread_lines() const { return unread_; }  ///< not understood, or beyond the most rows
  /// The row of an episode, or size().
  std::size_t RowOfIndex(std::uint64_t index) const;
  CommitRow Row(std::size_t row) const;

  // Columns, a value for each row in the order of commits. A second line of an index takes the place of the first.
  const std::vector<std::uint64_t>& index() const { return index_; }
  const std::vector<std::uint32_t>& attempt() const { return attempt_; }
  const std::vector<double>& t() const { return t_; }
  const std::vector<std::uint64_t>& bytes() const { return bytes_; }
  const std::vector<std::uint32_t>& steps() const { return steps_; }
  const std::vector<std::uint32_t>& frames() const { return frames_; }
  const std::vector<float>& path_m() const { return path_m_; }
  const std::vector<float>& jerk() const { return jerk_; }
  const std::vector<float>& joint_speed() const { return joint_speed_; }
  const std::vector<std::uint32_t>& draws() const { return draws_; }
  const std::vector<AttemptTimes>& timings() const { return timings_; }
  const WordColumn& worker() const { return worker_; }
  const WordColumn& host() const { return host_; }
  const WordColumn& fingerprint() const { return fingerprint_; }
  const WordColumn& outcome() const { return outcome_; }
  const WordColumn& robot() const { return robot_; }
  const WordColumn& task() const { return task_; }
  const WordColumn& target() const { return target_; }
  const WordColumn& reference() const { return reference_; }
  const WordColumn& instruction() const { return instruction_; }

 private:
  void Clear();
  Status TakeLines(int file, std::uint64_t length);
  void Take(std::string_view line);
  void Put(std::size_t row, const CommitRow& from);

  Path file_;
  std::size_t most_rows_;
  std::uint64_t generation_ = 0, unread_ = 0;
  std::uint64_t device_ = 0, inode_ = 0, offset_ = 0;  // of the file that was read, and how far
  std::string before_;                                 // what stands before `offset_`
  std::unordered_map<std::uint64_t, std::size_t> row_of_;
  std::vector<std::uint64_t> index_, bytes_;
  std::vector<std::uint32_t> attempt_, steps_, frames_, draws_;
  std::vector<double> t_;
  std::vector<float> path_m_, jerk_, joint_speed_;
  std::vector<std::array<float, 2>> place_m_;  // NaN: not said
  std::vector<AttemptTimes> timings_;
  WordColumn worker_, host_, fingerprint_, outcome_, robot_, task_, target_, reference_, instruction_;
};

}  // namespace etude::store
