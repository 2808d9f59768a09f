// SPDX-License-Identifier: Apache-2.0
// What a run measured, as JSON lines and as TensorBoard events.
#pragma once

#include <map>
#include <string>
#include <string_view>

#include "services/core/file.h"
#include "trainer/curriculum/scheduler.h"
#include "trainer/learn/event_file.h"

namespace etude::learn {

/// How a process that trained a run left it; a run that was killed says nothing.
enum class End { kFinished, kStopped, kFailed };
std::string_view ToString(End cause);  ///< finished | stopped | failed

/// OUT/metrics.jsonl: {"kind": "train"|"valid", "step", "elapsed_s", "time", name: value, ...}, {"kind": "stage",
/// "step", "stage", "name", "cause", "reason"}, {"kind": "checkpoint", "step", "time", "file", "sha256", "channel"} and
/// {"kind": "end", "step", "elapsed_s", "time", "cause", "reason"}; OUT/curriculum.jsonl: one line an advance, with its
/// cause (goal | plateau | budget); OUT/events.out.tfevents.*: tags "train/NAME", "valid/NAME". A step that goes back,
/// after a
/// --resume, takes the place of what stands before.
class MetricsLog {
 public:
  static Result<MetricsLog> Open(const Path& out);

  Status Write(const std::string& kind, std::uint64_t step, double elapsed_s,
               const std::map<std::string, double>& scalars);
  /// The line of curriculum.jsonl, and the one of metrics.jsonl: each by itself, since a disk may be full between them.
  Status WriteAdvance(const curriculum::Advance& advance, const std::string& stage_name);
  Status WriteStage(const curriculum::Advance& advance, const std::string& stage_name);
  /// @param reason  for people; of a failure its words
  Status WriteEnd(std::uint64_t step, double elapsed_s, End cause, const std::string& reason);
  Status Sync();

 private:
  MetricsLog(LineAppender lines, LineAppender advances, EventFile events)
      : lines_(std::move(lines)), advances_(std::move(advances)), events_(std::move(events)) {}
  LineAppender lines_, advances_;
  EventFile events_;
};

/// A line of kind "checkpoint" in OUT/metrics.jsonl, by who wrote the file. @param file  its name in OUT/checkpoints
Status NoteCheckpoint(const Path& out, std::uint64_t step, const std::string& file, const std::string& sha256,
                      const std::string& channel);

}  // namespace etude::learn
