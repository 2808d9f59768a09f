// SPDX-License-Identifier: Apache-2.0
#include "services/store/summary.h"

#include <set>
#include <system_error>
#include <tuple>

#include "services/episode/action.h"
#include "services/episode/codec.h"
#include "services/episode/tracks.h"
#include "services/spec/attempt_outcome.h"
#include "services/store/attempts.h"

namespace etude::store::internal {

EpisodeSummary Summarize(const Episode& episode, std::uint64_t frames, std::uint64_t bytes) {
  EpisodeSummary summary;
  summary.task = episode.task;
  summary.target = episode.target;
  summary.outcome = episode.outcome;
  summary.success = episode.success;
  summary.steps = static_cast<std::uint64_t>(episode.steps());
  summary.samples = static_cast<std::uint64_t>(FrameCount(episode.steps(), episode.image_stride));
  summary.frames = frames;
  summary.bytes = bytes;
  summary.scene.Add(episode.details);
  summary.planned.Add(episode.details);
  return summary;
}

EpisodeSummary Summarize(const EpisodeRecord& record) {
  std::uint64_t frames = 0;
  for (const auto& camera : record.frames) frames += camera.size();
  std::error_code error;
  const auto bytes = std::filesystem::file_size(record.path, error);
  return Summarize(record.episode, frames, error ? 0 : bytes);
}

EpisodeSummary SummaryOf(const CommitRow& row) {
  return {row.task,    row.target, row.outcome, row.success, row.steps,
          row.samples, row.frames, row.bytes,   row.scene,   row.planned};
}

void Statistics::Add(const CampaignSpec& spec, std::uint64_t index, const EpisodeSummary& episode) {
  ++episodes_;
  ++tasks_[episode.task];
  ++targets_[episode.target];
  ++outcomes_[episode.outcome];
  ++splits_[SplitOf(spec, index)];
  successes_ += episode.success ? 1 : 0;
  sum_.steps += episode.steps;
  sum_.samples += episode.samples;
  sum_.frames += episode.frames;
  sum_.bytes += episode.bytes;
  sum_.scene.Add(episode.scene);
  sum_.planned.Add(episode.planned);
}

OrderedJson Statistics::Json() const {
  return {{"episodes", episodes_},         {"successes", successes_},
          {"steps", sum_.steps},           {"seconds", static_cast<double>(sum_.steps) / kControlRate},
          {"samples", sum_.samples},       {"frames", sum_.frames},
          {"bytes", sum_.bytes},           {"tasks", tasks_},
          {"targets", targets_},           {"splits", splits_},
          {"outcomes", outcomes_},         {"scenes", sum_.scene.Json()},
          {"planned", sum_.planned.Json()}};
}

OrderedJson StatisticsOf(const CampaignSpec& spec, const std::map<std::uint64_t, EpisodeSummary>& episodes) {
  Statistics statistics;
  for (const auto& [index, episode] : episodes) statistics.Add(spec, index, episode);
  return statistics.Json();
}

OrderedJson FeatureTable(const Episode& episode) {
  OrderedJson table = OrderedJson::array();
  const auto add = [&](const std::string& name, const char* dtype, OrderedJson shape, double rate) {
    table.push_back({{"name", name}, {"dtype", dtype}, {"shape", std::move(shape)}, {"rate_hz", rate}});
  };
  VisitTracks(episode, [&](const std::string& name, const Track& track, int) {
    add("control/" + name, "float32", {"T", track.columns}, kControlRate);
  });
  add("control/phase", "uint8", OrderedJson::array({"T"}), kControlRate);
  add("control/supervise", "uint8", OrderedJson::array({"T"}), kControlRate);
  for (const auto& track : episode.cameras)
    add("obs/" + track.camera.name + "_image", "uint8", {"N", track.camera.height, track.camera.width, 3},
        kControlRate / episode.image_stride);
  return table;
}

std::map<std::string, std::uint64_t> FailuresByOutcome(const Path& dataset) {
  std::map<std::string, std::uint64_t> failures;
  // an attempt that was made again, since nothing was committed before a restart, failed once
  std::set<std::tuple<std::uint64_t, std::uint32_t, std::string>> seen;
  ForEachAttempt(dataset, [&](const AttemptLine& line) {
    if (line.outcome != kRecheckMismatch && seen.emplace(line.index, line.attempt, line.outcome).second)
      ++failures[line.outcome];
  });
  return failures;
}

}  // namespace etude::store::internal
