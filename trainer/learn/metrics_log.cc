// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/metrics_log.h"

#include <cmath>

#include "services/core/clock.h"
#include "services/core/config.h"

namespace etude::learn {

Result<MetricsLog> MetricsLog::Open(const Path& out) {
  ETUDE_ASSIGN_OR_RETURN(auto lines, LineAppender::Open(out / "metrics.jsonl"));
  ETUDE_ASSIGN_OR_RETURN(auto advances, LineAppender::Open(out / "curriculum.jsonl"));
  ETUDE_ASSIGN_OR_RETURN(auto events, EventFile::Open(out));
  return MetricsLog(std::move(lines), std::move(advances), std::move(events));
}

Status MetricsLog::Write(const std::string& kind, std::uint64_t step, double elapsed_s,
                         const std::map<std::string, double>& scalars) {
  OrderedJson line{{"kind", kind}, {"step", step}, {"elapsed_s", elapsed_s}, {"time", WallSeconds()}};
  std::map<std::string, double> tagged;
  for (const auto& [name, value] : scalars) {
    tagged[kind + "/" + name] = value;
    if (std::isfinite(value))
      line[name] = value;
    else
      line[name] = nullptr;  // JSON has no NaN
  }
  // the lines are what programs read: written again, because one of the two failed, an event stands twice and no line
  ETUDE_RETURN_IF_ERROR(events_.Write(step, tagged));
  return lines_.Append(line.dump());
}

Status MetricsLog::WriteAdvance(const curriculum::Advance& advance, const std::string& stage_name) {
  const OrderedJson line{{"step", advance.step},
                         {"from", advance.from},
                         {"to", advance.to},
                         {"name", stage_name},
                         {"cause", ToString(advance.cause)},
                         {"reason", advance.reason}};
  return advances_.Append(line.dump());
}

Status MetricsLog::WriteStage(const curriculum::Advance& advance, const std::string& stage_name) {
  return lines_.Append(OrderedJson{
      {"kind", "stage"},
      {"step", advance.step},
      {"stage", advance.to},
      {"name", stage_name},
      {"cause", ToString(advance.cause)},
      {"reason",
       advance.reason}}.dump());
}

std::string_view ToString(End cause) {
  switch (cause) {
    case End::kFinished:
      return "finished";
    case End::kStopped:
      return "stopped";
    case End::kFailed:
      return "failed";
  }
  return "?";
}

Status MetricsLog::WriteEnd(std::uint64_t step, double elapsed_s, End cause, const std::string& reason) {
  const OrderedJson line{
      {"kind", "end"},   {"step", step}, {"elapsed_s", elapsed_s}, {"time", WallSeconds()}, {"cause", ToString(cause)},
      {"reason", reason}};
  ETUDE_RETURN_IF_ERROR(lines_.Append(JsonText(line)));
  return lines_.Sync();
}

Status NoteCheckpoint(const Path& out, std::uint64_t step, const std::string& file, const std::string& sha256,
                      const std::string& channel) {
  ETUDE_ASSIGN_OR_RETURN(auto lines, LineAppender::Open(out / "metrics.jsonl"));
  const OrderedJson line{{"kind", "checkpoint"}, {"step", step},     {"time", WallSeconds()},
                         {"file", file},         {"sha256", sha256}, {"channel", channel}};
  return lines.Append(line.dump());
}

Status MetricsLog::Sync() {
  ETUDE_RETURN_IF_ERROR(lines_.Sync());
  return advances_.Sync();
}

}  // namespace etude::learn
