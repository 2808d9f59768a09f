// SPDX-License-Identifier: Apache-2.0
// LeRobot 3.0: files of many episodes each, metadata as Parquet.
#include <fmt/format.h>

#include <optional>

#include "services/core/command.h"
#include "services/export/json_table.h"
#include "services/export/lerobot_files.h"
#include "services/export/parquet_writer.h"
#include "services/export/picture_stream.h"

namespace etude::exports::internal {
namespace {

constexpr std::size_t kMetadataRows = 100;  // episodes in memory

// chunk-000/file-000: which file of its kind
struct FileNumber {
  std::int64_t number = 0;
  std::int64_t chunk() const { return number / kChunkSize; }
  std::int64_t file() const { return number % kChunkSize; }
  Path In(const Path& folder, const char* extension) const {
    return folder / fmt::format("chunk-{:03d}", chunk()) / fmt::format("file-{:03d}{}", file(), extension);
  }
};

// One file after the other, each of about `limit` bytes.
template <class File>
class Rolling {
 public:
  Rolling(Path folder, const char* extension, std::uint64_t limit)
      : folder_(std::move(folder)), extension_(extension), limit_(limit) {}

  /// What comes next comes into number(), which `open` opens where it is a new one.
  template <class Open>
  Status Begin(const Open& open) {
    if (file_ && file_->bytes() >= limit_) {
      ETUDE_RETURN_IF_ERROR(Finish());
      ++number_.number;
    }
    if (file_) return {};
    const Path path = number_.In(folder_, extension_);
    ETUDE_RETURN_IF_ERROR(MakeFolders(path.parent_path()));
    ETUDE_ASSIGN_OR_RETURN(file_, open(path));
    return {};
  }
  File& file() { return *file_; }
  const File& file() const { return *file_; }
  FileNumber number() const { return number_; }
  Status Finish() {
    if (!file_) return {};
    ETUDE_RETURN_IF_ERROR(file_->Finish());
    file_.reset();
    return {};
  }

 private:
  Path folder_;
  const char* extension_;
  std::uint64_t limit_;
  FileNumber number_;
  std::optional<File> file_;
};

// Row groups.
class RollingTable : public Rolling<ParquetWriter> {
 public:
  RollingTable(Path folder, std::uint64_t limit) : Rolling(std::move(folder), ".parquet", limit) {}

  /// The file that the next row group comes into.
  Result<FileNumber> Next(const std::vector<ParquetColumn>& columns) {
    ETUDE_RETURN_IF_ERROR(Begin([&](const Path& path) { return ParquetWriter::Create(path, columns, {}); }));
    return number();
  }
  Status Write(std::size_t rows, const std::vector<ParquetCells>& cells) { return file().WriteRowGroup(rows, cells); }
};

// Episodes' pictures; those of an episode stay together.
class RollingVideo : public Rolling<video::Mp4Writer> {
 public:
  RollingVideo(Path folder, const video::Mp4Options& options, std::uint64_t limit)
      : Rolling(std::move(folder), ".mp4", limit), options_(options) {}

  Status Begin() {
    return Rolling::Begin([&](const Path& path) { return video::Mp4Writer::Open(path, options_); });
  }
  // a time is a whole number of pictures over the rate: never a sum of rounded times
  double Now() const { return static_cast<double>(file().pictures()) / options_.rate.numerator; }

 private:
  video::Mp4Options options_;
};

// What pandas wants to be told, so that rows are found by their sentence.
OrderedJson PandasMetadata() {
  const auto column = [](const char* name, const char* type, const char* numpy) {
    return OrderedJson{
        {"name", name}, {"field_name", name}, {"pandas_type", type}, {"numpy_type", numpy}, {"metadata", nullptr}};
  };
  OrderedJson heading = column("", "unicode", "object");
  heading["name"] = nullptr;
  heading["field_name"] = nullptr;
  heading["metadata"] = {{"encoding", "UTF-8"}};
  return {
      {"index_columns", OrderedJson::array({"task"})},
      {"column_indexes", OrderedJson::array({heading})},
      {"columns", OrderedJson::array({column("task_index", "int64", "int64"), column("task", "unicode", "object")})},
      {"creator", {{"library", "etude"}, {"version", Version()}}},
      {"pandas_version", "2.2.0"}};
}

class Files30 final : public LeRobotFiles {
 public:
  Files30(const Path& folder, const FrameLayout& layout, const LeRobotOptions& options)
      : folder_(folder),
        layout_(layout),
        data_(folder / "data", options.data_file_bytes),
        metadata_(folder / "meta/episodes", options.data_file_bytes) {
    for (const auto& camera : layout.cameras)
      videos_.emplace_back(folder / "videos" / camera.name, VideoOptions(camera, layout.fps), options.video_file_bytes);
  }

  Status Write(LeRobotEpisode& episode) override {
    const auto rows = static_cast<std::int64_t>(episode.table.rows);
    ETUDE_ASSIGN_OR_RETURN(const FileNumber data, data_.Next(exports::ColumnsOf(layout_)));
    ETUDE_RETURN_IF_ERROR(data_.Write(episode.table.rows, episode.table.cells));
    OrderedJson row{{"episode_index", episode.place.episode},
                    {"tasks", OrderedJson::array({episode.source->instruction})},
                    {"length", rows},
                    {"data/chunk_index", data.chunk()},
                    {"data/file_index", data.file()},
                    {"dataset_from_index", episode.place.first_index},
                    {"dataset_to_index", episode.place.first_index + rows}};
    for (std::size_t i = 0; i < videos_.size(); ++i) ETUDE_RETURN_IF_ERROR(WriteVideo(episode, i, row));
    const OrderedJson statistics = StatisticsJson(episode.table.statistics, WithQuantiles::kYes);
    for (const auto& [feature, values] : statistics.items())
      for (const auto& [name, value] : values.items()) row["stats/" + feature + "/" + name] = value;
    row.update(episode.facts);
    waiting_.push_back(std::move(row));
    return waiting_.size() < kMetadataRows ? Status{} : WriteMetadata();
  }

  Status Finish(const std::vector<std::string>& tasks, const std::map<std::string, FeatureStatistics>& statistics,
                LeRobotReport& report) override {
    ETUDE_RETURN_IF_ERROR(data_.Finish());
    for (auto& video : videos_) ETUDE_RETURN_IF_ERROR(video.Finish());
    ETUDE_RETURN_IF_ERROR(WriteMetadata());
    ETUDE_RETURN_IF_ERROR(metadata_.Finish());
    ETUDE_RETURN_IF_ERROR(WriteTasks(tasks));
    ETUDE_RETURN_IF_ERROR(WriteFileAtomically(folder_ / "meta/stats.json",
                                              StatisticsJson(statistics, WithQuantiles::kYes).dump(4) + "\n"));
    OrderedJson info = InfoJson("v3.0", layout_, report);
    info["data_files_size_in_mb"] = 100;
    info["video_files_size_in_mb"] = 200;
    info["data_path"] = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet";
    info["video_path"] = nullptr;
    if (!layout_.cameras.empty())
      info["video_path"] = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4";
    return WriteFileAtomically(folder_ / "meta/info.json", info.dump(4) + "\n");
  }

 private:
  Status WriteVideo(LeRobotEpisode& episode, std::size_t i, OrderedJson& row) {
    const CameraFeature& camera = layout_.cameras[i];
    RollingVideo& video = videos_[i];
    ETUDE_RETURN_IF_ERROR(video.Begin());
    const double from = video.Now();
    for (std::size_t c = 0; c < episode.source->cameras.size(); ++c) {
      if (episode.source->cameras[c].camera.name != camera.camera) continue;
      ETUDE_ASSIGN_OR_RETURN(episode.table.statistics[camera.name], WritePictures(*episode.source, c, video.file()));
    }
    const std::string key = "videos/" + camera.name + "/";
    row[key + "chunk_index"] = video.number().chunk();
    row[key + "file_index"] = video.number().file();
    row[key + "from_timestamp"] = from;
    row[key + "to_timestamp"] = video.Now();
    return {};
  }

  Status WriteMetadata() {
    if (waiting_.empty()) return {};
    for (const char* key : {"meta/episodes/chunk_index", "meta/episodes/file_index"})
      for (auto& row : waiting_) row[key] = 0;
    const auto columns = ColumnsOf(waiting_[0]);
    ETUDE_ASSIGN_OR_RETURN(const FileNumber number, metadata_.Next(columns));
    for (auto& row : waiting_) {
      row["meta/episodes/chunk_index"] = number.chunk();
      row["meta/episodes/file_index"] = number.file();
    }
    ETUDE_ASSIGN_OR_RETURN(const auto cells, CellsOf(waiting_, columns));
    ETUDE_RETURN_IF_ERROR(metadata_.Write(waiting_.size(), cells));
    waiting_.clear();
    return {};
  }

  Status WriteTasks(const std::vector<std::string>& tasks) {
    std::vector<std::int64_t> numbers;
    for (std::size_t i = 0; i < tasks.size(); ++i) numbers.push_back(static_cast<std::int64_t>(i));
    ETUDE_ASSIGN_OR_RETURN(auto file,
                           ParquetWriter::Create(folder_ / "meta/tasks.parquet",
                                                 {{"task_index", ParquetType::kInt64}, {"task", ParquetType::kText}},
                                                 {{"pandas", PandasMetadata().dump()}}));
    ETUDE_RETURN_IF_ERROR(file.WriteRowGroup(tasks.size(), {Cells(numbers), Cells(tasks)}));
    return file.Finish();
  }

  Path folder_;
  FrameLayout layout_;
  RollingTable data_, metadata_;
  std::vector<RollingVideo> videos_;  // as layout_.cameras
  std::vector<OrderedJson> waiting_;  // metadata of episodes, not yet on the disk
};

}  // namespace

std::unique_ptr<LeRobotFiles> MakeFiles30(const Path& folder, const FrameLayout& layout,
                                          const LeRobotOptions& options) {
  return std::make_unique<Files30>(folder, layout, options);
}

}  // namespace etude::exports::internal
