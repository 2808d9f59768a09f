// SPDX-License-Identifier: Apache-2.0
#include "services/export/lerobot.h"

#include <fmt/format.h>

#include <filesystem>
#include <map>
#include <optional>

#include "services/core/stop.h"
#include "services/export/lerobot_files.h"
#include "services/spec/campaign_spec.h"
#include "services/store/dataset.h"

namespace etude::exports {
namespace internal {

OrderedJson InfoJson(const char* version, const FrameLayout& layout, const LeRobotReport& report) {
  return {{"codebase_version", version},
          {"robot_type", layout.robot},
          {"total_episodes", report.episodes},
          {"total_frames", report.frames},
          {"total_tasks", report.tasks},
          {"chunks_size", kChunkSize},
          {"fps", layout.fps},
          {"splits", {{"train", fmt::format("0:{}", report.episodes)}}},
          {"features", FeaturesJson(layout)}};
}

OrderedJson StatisticsJson(const std::map<std::string, FeatureStatistics>& statistics, WithQuantiles quantiles) {
  OrderedJson json = OrderedJson::object();
  for (const auto& [name, feature] : statistics)
    json[name] = ToJson(feature, name.starts_with("observation.images."), quantiles);
  return json;
}

}  // namespace internal

namespace {

using internal::LeRobotEpisode;
using internal::LeRobotFiles;

// Ours, for who wants to go back to the episode: what LeRobot has no place for.
OrderedJson FactsOf(const Episode& episode, const CampaignSpec& spec) {
  return {{"etude.campaign", episode.campaign},
          {"etude.index", episode.index},
          {"etude.attempt", episode.attempt},
          {"etude.seed", std::to_string(episode.seed)},  // may be larger than an int64
          {"etude.task", episode.task},
          {"etude.target", episode.target},
          {"etude.reference", episode.reference},
          {"etude.robot", episode.robot},
          {"etude.outcome", episode.outcome},
          {"etude.split", SplitOf(spec, episode.index)},
          {"etude.scene_sha256", episode.scene_sha256}};
}

class Exporter {
 public:
  Exporter(const store::DatasetReader& reader, const Path& folder, const LeRobotOptions& options)
      : reader_(reader), folder_(folder), options_(options) {}

  Status Add(std::uint64_t index) {
    ETUDE_ASSIGN_OR_RETURN(const Episode source, reader_.ReadWhole(index));
    ETUDE_RETURN_IF_ERROR(FitLayout(source));
    LeRobotEpisode episode{.source = &source, .place = PlaceOf(source.instruction), .table = {}, .facts = {}};
    episode.table = TableOf(*layout_, source, episode.place);
    episode.facts = FactsOf(source, reader_.spec());
    if (Status written = files_->Write(episode); !written)
      return Fail(written.error().Wrap(fmt::format("export episode {}", index)));
    for (const auto& [name, statistics] : episode.table.statistics)
      statistics_[name] = Merge(statistics_[name], statistics);
    ++report_.episodes;
    report_.frames += episode.table.rows;
    report_.videos += layout_->cameras.size();
    return {};
  }

  Result<LeRobotReport> Finish() {
    std::vector<std::string> texts(tasks_.size());
    for (const auto& [text, number] : tasks_) texts[static_cast<std::size_t>(number)] = text;
    report_.tasks = texts.size();
    ETUDE_RETURN_IF_ERROR(files_->Finish(texts, statistics_, report_));
    return report_;
  }

 private:
  // the first episode says what all are
  Status FitLayout(const Episode& episode) {
    if (layout_) return CheckLayout(*layout_, episode);
    ETUDE_ASSIGN_OR_RETURN(layout_, LayoutOf(episode));
    files_ = options_.version == LeRobotVersion::k30 ? internal::MakeFiles30(folder_, *layout_, options_)
                                                     : internal::MakeFiles21(folder_, *layout_);
    return {};
  }

  FramePlace PlaceOf(const std::string& sentence) {
    const auto [task, added] = tasks_.emplace(sentence, static_cast<std::int64_t>(tasks_.size()));
    return {static_cast<std::int64_t>(report_.episodes), static_cast<std::int64_t>(report_.frames), task->second};
  }

  const store::DatasetReader& reader_;
  Path folder_;
  const LeRobotOptions& options_;
  std::optional<FrameLayout> layout_;
  std::unique_ptr<LeRobotFiles> files_;
  std::map<std::string, std::int64_t> tasks_;  // sentence -> number
  std::map<std::string, FeatureStatistics> statistics_;
  LeRobotReport report_;
};

}  // namespace

Result<LeRobotReport> ExportLeRobot(const Path& dataset, const Path& out, const LeRobotOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(dataset));
  auto indices = options.indices;
  if (indices.empty()) {
    ETUDE_ASSIGN_OR_RETURN(indices, reader.List());
  }
  if (indices.empty())
    return Fail(Code::kNotFound, fmt::format("export '{}': it has no episodes yet", dataset.string()));
  ETUDE_ASSIGN_OR_RETURN(auto folder, OutputFolder::Create(out, options.leftover));
  Exporter exporter(reader, folder.path(), options);
  for (std::size_t i = 0; i < indices.size(); ++i) {
    if (StopRequested())
      return Fail(Code::kExhausted, fmt::format("stopped after {} of {} episodes; what is there lies in '{}' "
                                                "(--restart begins anew)",
                                                i, indices.size(), folder.path().string()));
    if (Status added = exporter.Add(indices[i]); !added) {
      // refused, and would be again: what was made until here is only in the way of the next try
      std::error_code ignored;
      if (added.error().code == Code::kInvalidArgument) std::filesystem::remove_all(folder.path(), ignored);
      return Fail(added.error());
    }
    if (options.progress) options.progress(i + 1, indices.size());
  }
  ETUDE_ASSIGN_OR_RETURN(const LeRobotReport report, exporter.Finish());
  ETUDE_RETURN_IF_ERROR(folder.Commit());
  return report;
}

}  // namespace etude::exports
