// SPDX-License-Identifier: Apache-2.0
// LeRobot 2.1: a Parquet file and a video a camera of each episode, metadata as lines of JSON.
#include <fmt/format.h>

#include <optional>

#include "services/export/lerobot_files.h"
#include "services/export/parquet_writer.h"
#include "services/export/picture_stream.h"

namespace etude::exports::internal {
namespace {

class Files21 final : public LeRobotFiles {
 public:
  Files21(Path folder, const FrameLayout& layout) : folder_(std::move(folder)), layout_(layout) {}

  Status Write(LeRobotEpisode& episode) override {
    const std::int64_t number = episode.place.episode;
    const std::string chunk = fmt::format("chunk-{:03d}", number / kChunkSize);
    ETUDE_RETURN_IF_ERROR(WriteVideos(episode, folder_ / "videos" / chunk));
    const Path data = folder_ / "data" / chunk;
    ETUDE_RETURN_IF_ERROR(MakeFolders(data));
    ETUDE_ASSIGN_OR_RETURN(
        auto file, ParquetWriter::Create(data / fmt::format("episode_{:06d}.parquet", number), ColumnsOf(layout_), {}));
    ETUDE_RETURN_IF_ERROR(file.WriteRowGroup(episode.table.rows, episode.table.cells));
    ETUDE_RETURN_IF_ERROR(file.Finish());
    return WriteLines(episode);
  }

  Status Finish(const std::vector<std::string>& tasks, const std::map<std::string, FeatureStatistics>&,
                LeRobotReport& report) override {
    ETUDE_RETURN_IF_ERROR(episodes_->Sync());
    ETUDE_RETURN_IF_ERROR(statistics_->Sync());
    std::string lines;
    for (std::size_t i = 0; i < tasks.size(); ++i) lines += JsonText({{"task_index", i}, {"task", tasks[i]}}) + "\n";
    ETUDE_RETURN_IF_ERROR(WriteFileAtomically(folder_ / "meta/tasks.jsonl", lines));
    OrderedJson info = InfoJson("v2.1", layout_, report);
    info["total_videos"] = report.videos;
    info["total_chunks"] = (static_cast<std::int64_t>(report.episodes) + kChunkSize - 1) / kChunkSize;
    info["data_path"] = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet";
    info["video_path"] = nullptr;
    if (!layout_.cameras.empty())
      info["video_path"] = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4";
    return WriteFileAtomically(folder_ / "meta/info.json", info.dump(4) + "\n");
  }

 private:
  Status WriteVideos(LeRobotEpisode& episode, const Path& folder) {
    for (const auto& camera : layout_.cameras) {
      ETUDE_RETURN_IF_ERROR(MakeFolders(folder / camera.name));
      const Path path = folder / camera.name / fmt::format("episode_{:06d}.mp4", episode.place.episode);
      ETUDE_ASSIGN_OR_RETURN(auto video, video::Mp4Writer::Open(path, VideoOptions(camera, layout_.fps)));
      for (std::size_t c = 0; c < episode.source->cameras.size(); ++c) {
        if (episode.source->cameras[c].camera.name != camera.camera) continue;
        ETUDE_ASSIGN_OR_RETURN(episode.table.statistics[camera.name], WritePictures(*episode.source, c, video));
      }
      ETUDE_RETURN_IF_ERROR(video.Finish());
    }
    return {};
  }

  Status WriteLines(const LeRobotEpisode& episode) {
    if (!episodes_) {
      ETUDE_RETURN_IF_ERROR(MakeFolders(folder_ / "meta"));
      ETUDE_ASSIGN_OR_RETURN(episodes_, LineAppender::Open(folder_ / "meta/episodes.jsonl"));
      ETUDE_ASSIGN_OR_RETURN(statistics_, LineAppender::Open(folder_ / "meta/episodes_stats.jsonl"));
    }
    OrderedJson line{{"episode_index", episode.place.episode},
                     {"tasks", OrderedJson::array({episode.source->instruction})},
                     {"length", episode.table.rows}};
    line.update(episode.facts);
    ETUDE_RETURN_IF_ERROR(episodes_->Append(JsonText(line)));
    return statistics_->Append(JsonText({{"episode_index", episode.place.episode},
                                         {"stats", StatisticsJson(episode.table.statistics, WithQuantiles::kNo)}}));
  }

  Path folder_;
  FrameLayout layout_;
  std::optional<LineAppender> episodes_, statistics_;
};

}  // namespace

std::unique_ptr<LeRobotFiles> MakeFiles21(const Path& folder, const FrameLayout& layout) {
  return std::make_unique<Files21>(folder, layout);
}

}  // namespace etude::exports::internal
