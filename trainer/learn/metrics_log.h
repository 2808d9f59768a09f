// SPDX-License-Identifier: Apache-2.0
// What a run measured, as JSON lines and as TensorBoard events.
#pragma once

#include <map>
#include <string>

#include "services/core/file.h"
#include "trainer/curriculum/scheduler.h"
#include "trainer/learn/event_file.h"

namespace etude::learn {

/// OUT/metrics.jsonl: {"kind": "train"|"valid", "step", "elapsed_s", "time", name: value, ...};
/// OUT/curriculum.jsonl: one line an advance; OUT/events.out.tfevents.*: tags "train/NAME",
/// "valid/NAME".
class MetricsLog {
 public:
  static Result<MetricsLog> Open(const Path& out);

  Status Write(const std::string& kind, std::uint64_t step, double elapsed_s,
               const std::map<std::string, double>& scalars);
  Status WriteAdvance(const curriculum::Advance& advance, const std::string& stage_name);
  Status Sync();

 private:
  MetricsLog(LineAppender lines, LineAppender advances, EventFile events)
      : lines_(std::move(lines)), advances_(std::move(advances)), events_(std::move(events)) {}
  LineAppender lines_, advances_;
  EventFile events_;
};

}  // namespace etude::learn
