// SPDX-License-Identifier: Apache-2.0
// Tests services/export/lerobot.cc, lerobot_files_30.cc, lerobot_files_21.cc, frame_table.cc and picture_stream.cc: the
// rules that LeRobot's loader has, looked at with readers of our own.
#include "services/export/lerobot.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

#include "services/store/dataset.h"
#include "tests/services/export/node_reader.h"
#include "tests/services/export/parquet_reader.h"
#include "tests/services/video/video_reader.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::exports {
namespace lerobot_test {

constexpr int kEpisodes = 5;
constexpr const char* kCamera = "observation.images.front";

int StepsOf(std::uint64_t index) { return 40 + 7 * static_cast<int>(index); }  // 8, 10, 11, 13, 14 pictures

class LeRobot : public testing::Test {
 protected:
  void SetUp() override {
    auto writer = store::DatasetWriter::Open(dataset_, spec_);
    ASSERT_THAT(writer, IsOk());
    for (std::uint64_t i = 0; i < kEpisodes; ++i)
      ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec_, i, StepsOf(i))), IsOk());
  }

  OrderedJson Json(const std::string& name) {
    return OrderedJson::parse(ReadTextFile(out_ / name).value_or(""), nullptr, false);
  }
  std::vector<OrderedJson> Lines(const std::string& name) {
    std::istringstream text(ReadTextFile(out_ / name).value_or(""));
    std::vector<OrderedJson> lines;
    for (std::string line; std::getline(text, line);) lines.push_back(OrderedJson::parse(line, nullptr, false));
    return lines;
  }

  void CheckRow(const OrderedJson& row, const Episode& episode, int k, std::int64_t index) {
    const int step = k * episode.image_stride;
    const int command = std::min(step + episode.image_stride, episode.steps()) - 1;
    EXPECT_EQ(row["index"], index);
    EXPECT_EQ(row["frame_index"], k);
    EXPECT_EQ(row["episode_index"], episode.index);
    EXPECT_EQ(row["timestamp"].get<float>(), static_cast<float>(k / 25.0));
    for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(row["action"][i].get<float>(), episode.actions_abs.row(command)[i]);
    for (std::size_t i = 0; i < 6; ++i)
      EXPECT_EQ(row["observation.state"][i].get<float>(), episode.joint_pos.row(step)[i]);
    EXPECT_EQ(row["observation.state"][6].get<float>(), episode.gripper_qpos.row(step)[0]);
    EXPECT_EQ(row["next.done"], step + episode.image_stride >= episode.steps());
  }

  TemporaryFolder folder_;
  CampaignSpec spec_ = SyntheticSpec();
  Path dataset_ = folder_ / "data", out_ = folder_ / "out";
};

TEST_F(LeRobot, Version30KeepsItsRules) {
  const auto report = ExportLeRobot(dataset_, out_, {});
  ASSERT_THAT(report, IsOk());

  const OrderedJson info = Json("meta/info.json");
  EXPECT_EQ(info["codebase_version"], "v3.0");
  EXPECT_EQ(info["fps"], 25);
  EXPECT_EQ(info["total_episodes"], kEpisodes);
  EXPECT_EQ(info["splits"]["train"], "0:5");
  const ParquetFile data(out_ / "data/chunk-000/file-000.parquet");
  EXPECT_EQ(info["total_frames"], data.rows().size());
  EXPECT_EQ(data.footer().at(4).list.size(), static_cast<std::size_t>(kEpisodes)) << "a row group an episode";
  for (const auto& column : data.columns()) EXPECT_TRUE(info["features"].contains(column)) << column;
  EXPECT_EQ(info["features"].size(), data.columns().size() + 1);
  EXPECT_EQ(info["features"]["action"]["shape"], OrderedJson::parse("[10]"));
  EXPECT_TRUE(info["features"]["index"]["names"].is_null());

  const ParquetFile tasks(out_ / "meta/tasks.parquet");
  EXPECT_EQ(OrderedJson::parse(tasks.metadata().at("pandas"))["index_columns"], OrderedJson::array({"task"}));
  std::size_t at = 0;
  for (std::uint64_t i = 0; i < kEpisodes; ++i) {
    const Episode episode = MakeSyntheticEpisode(spec_, i, StepsOf(i));
    for (int k = 0; k * 5 < episode.steps(); ++k, ++at) {
      ASSERT_LT(at, data.rows().size());
      CheckRow(data.rows()[at], episode, k, static_cast<std::int64_t>(at));
      EXPECT_EQ(tasks.rows()[data.rows()[at]["task_index"].get<std::size_t>()]["task"], episode.instruction);
    }
  }
  EXPECT_EQ(at, data.rows().size());
}

TEST_F(LeRobot, Version30SaysWhereEachEpisodeIs) {
  LeRobotOptions options;
  options.data_file_bytes = options.video_file_bytes = 1;  // a file an episode
  ASSERT_THAT(ExportLeRobot(dataset_, out_, options), IsOk());

  const ParquetFile episodes(out_ / "meta/episodes/chunk-000/file-000.parquet");
  ASSERT_EQ(episodes.rows().size(), static_cast<std::size_t>(kEpisodes));
  const std::string video = std::string("videos/") + kCamera + "/";
  for (std::int64_t i = 0; i < kEpisodes; ++i) {
    const OrderedJson& row = episodes.rows()[static_cast<std::size_t>(i)];
    EXPECT_EQ(row["episode_index"], i);
    EXPECT_EQ(row["data/file_index"], i);
    EXPECT_EQ(row[video + "file_index"], i);
    EXPECT_EQ(row[video + "from_timestamp"], 0.0);
    EXPECT_EQ(row[video + "to_timestamp"].get<double>(), row["length"].get<double>() / 25);
    EXPECT_EQ(row["meta/episodes/file_index"], 0);
    EXPECT_EQ(row["stats/action/mean"].size(), 10u);
    EXPECT_EQ(row["stats/action/count"], OrderedJson::array({row["length"]}));
    EXPECT_EQ(row["stats/" + std::string(kCamera) + "/max"].size(), 3u);
    EXPECT_EQ(row["etude.index"], i);
    const ParquetFile data(out_ / fmt::format("data/chunk-000/file-{:03d}.parquet", i));
    EXPECT_EQ(data.rows().size(), row["length"].get<std::size_t>());
    EXPECT_EQ(data.rows()[0]["index"], row["dataset_from_index"]);
    EXPECT_EQ(data.rows().back()["index"].get<std::int64_t>() + 1, row["dataset_to_index"].get<std::int64_t>());
  }
  const OrderedJson all = Json("meta/stats.json");
  EXPECT_EQ(all["action"]["count"][0], Json("meta/info.json")["total_frames"]);
  EXPECT_TRUE(all["action"].contains("q99"));
}

TEST_F(LeRobot, Version30PutsEpisodesOneAfterTheOtherIntoOneVideo) {
  ASSERT_THAT(ExportLeRobot(dataset_, out_, {}), IsOk());

  const video::VideoContent video = video::ReadVideo(out_ / "videos" / kCamera / "chunk-000/file-000.mp4");
  const ParquetFile episodes(out_ / "meta/episodes/chunk-000/file-000.parquet");
  std::size_t first = 0;
  for (const auto& row : episodes.rows()) {
    const double from = row[std::string("videos/") + kCamera + "/from_timestamp"].get<double>();
    ASSERT_LT(first, video.times.size());
    EXPECT_NEAR(from, video.times[first], 1e-12);
    EXPECT_TRUE(video.keys[first]) << "an episode begins with a key frame";
    first += row["length"].get<std::size_t>();
  }
  EXPECT_EQ(first, video.times.size());
  for (std::size_t k = 0; k < video.times.size(); ++k) EXPECT_NEAR(video.times[k], static_cast<double>(k) / 25, 1e-12);
}

TEST_F(LeRobot, Version21HasAFileAnEpisode) {
  LeRobotOptions options;
  options.version = LeRobotVersion::k21;
  ASSERT_THAT(ExportLeRobot(dataset_, out_, options), IsOk());

  const OrderedJson info = Json("meta/info.json");
  EXPECT_EQ(info["codebase_version"], "v2.1");
  EXPECT_EQ(info["total_videos"], kEpisodes);
  EXPECT_EQ(info["total_chunks"], 1);
  const auto episodes = Lines("meta/episodes.jsonl"), statistics = Lines("meta/episodes_stats.jsonl"),
             tasks = Lines("meta/tasks.jsonl");
  ASSERT_EQ(episodes.size(), static_cast<std::size_t>(kEpisodes));
  ASSERT_EQ(statistics.size(), static_cast<std::size_t>(kEpisodes));
  EXPECT_EQ(info["total_tasks"], tasks.size());
  std::int64_t index = 0;
  for (std::uint64_t i = 0; i < kEpisodes; ++i) {
    const Episode episode = MakeSyntheticEpisode(spec_, i, StepsOf(i));
    const ParquetFile data(out_ / fmt::format("data/chunk-000/episode_{:06d}.parquet", i));
    EXPECT_EQ(episodes[i]["length"], data.rows().size());
    EXPECT_EQ(episodes[i]["tasks"], OrderedJson::array({episode.instruction}));
    EXPECT_FALSE(statistics[i]["stats"]["action"].contains("q01"));
    for (std::size_t k = 0; k < data.rows().size(); ++k)
      CheckRow(data.rows()[k], episode, static_cast<int>(k), index++);
    const video::VideoContent video =
        video::ReadVideo(out_ / "videos/chunk-000" / kCamera / fmt::format("episode_{:06d}.mp4", i));
    EXPECT_EQ(video.times.size(), data.rows().size());
  }
}

// By readers that are not ours.
class LeRobotReadBy : public LeRobot, public testing::WithParamInterface<const char*> {};

TEST_P(LeRobotReadBy, HasEveryRow) {
  ASSERT_THAT(ExportLeRobot(dataset_, out_, {}), IsOk());
  if (!ReadWithNode(GetParam(), out_ / "meta/tasks.parquet")) GTEST_SKIP() << GetParam() << " is not there";

  const auto data = ReadWithNode(GetParam(), out_ / "data/chunk-000/file-000.parquet");
  const auto episodes = ReadWithNode(GetParam(), out_ / "meta/episodes/chunk-000/file-000.parquet");

  const ParquetFile own(out_ / "data/chunk-000/file-000.parquet");
  ASSERT_EQ((*data)["rows"].size(), own.rows().size());
  for (std::size_t i = 0; i < own.rows().size(); ++i) {
    EXPECT_EQ((*data)["rows"][i]["index"], std::to_string(i));
    EXPECT_EQ((*data)["rows"][i]["next.done"], own.rows()[i]["next.done"]);
    EXPECT_FLOAT_EQ((*data)["rows"][i]["action"][2].get<float>(), own.rows()[i]["action"][2].get<float>());
  }
  EXPECT_EQ((*episodes)["rows"].size(), static_cast<std::size_t>(kEpisodes));
}

TEST_P(LeRobotReadBy, HasEveryRowOfVersion21) {
  LeRobotOptions options;
  options.version = LeRobotVersion::k21;
  ASSERT_THAT(ExportLeRobot(dataset_, out_, options), IsOk());
  const auto file = [this](int i) { return out_ / fmt::format("data/chunk-000/episode_{:06d}.parquet", i); };
  if (!ReadWithNode(GetParam(), file(0))) GTEST_SKIP() << GetParam() << " is not there";

  std::size_t index = 0;
  for (int i = 0; i < kEpisodes; ++i) {
    const auto data = ReadWithNode(GetParam(), file(i));
    ASSERT_TRUE(data) << i;
    const ParquetFile own(file(i));
    ASSERT_EQ((*data)["rows"].size(), own.rows().size());
    for (std::size_t k = 0; k < own.rows().size(); ++k) {
      const OrderedJson &row = (*data)["rows"][k], &wanted = own.rows()[k];
      EXPECT_EQ(row["index"], std::to_string(index++));
      EXPECT_EQ(row["episode_index"], std::to_string(i));
      EXPECT_EQ(row["frame_index"], std::to_string(k));
      EXPECT_FLOAT_EQ(row["timestamp"].get<float>(), wanted["timestamp"].get<float>());
      EXPECT_FLOAT_EQ(row["action"][2].get<float>(), wanted["action"][2].get<float>());
    }
  }
  EXPECT_EQ(index, Json("meta/info.json")["total_frames"].get<std::size_t>());
}

std::string NameOfReader(const testing::TestParamInfo<const char*>& info) {
  return std::string(info.param) == "hyparquet" ? "Hyparquet" : "ParquetWasm";
}

INSTANTIATE_TEST_SUITE_P(Readers, LeRobotReadBy, testing::ValuesIn(kNodeReaders), NameOfReader);

TEST_F(LeRobot, TakesOnlyTheEpisodesThatAreAskedFor) {
  LeRobotOptions options;
  options.indices = {1, 3};
  std::vector<std::uint64_t> done;
  options.progress = [&](std::uint64_t n, std::uint64_t) { done.push_back(n); };
  const auto report = ExportLeRobot(dataset_, out_, options);

  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->episodes, 2u);
  EXPECT_EQ(report->frames, 10u + 13u);
  EXPECT_THAT(done, testing::ElementsAre(1, 2));
}

TEST_F(LeRobot, WritesOverNothing) {
  ASSERT_TRUE(MakeFolders(folder_ / "out.partial"));
  EXPECT_THAT(ExportLeRobot(dataset_, out_, {}), MessageHas("--restart"));
  LeRobotOptions options;
  options.leftover = Leftover::kRemove;
  EXPECT_THAT(ExportLeRobot(dataset_, out_, options), IsOk());
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out.partial"));
  EXPECT_THAT(ExportLeRobot(dataset_, out_, options), MessageHas("is there already"));
}

TEST_F(LeRobot, RefusesWhatCannotBeOneDataset) {
  EXPECT_THAT(ExportLeRobot(folder_ / "none", out_, {}), HasCode(Code::kNotFound));
  {
    auto writer = store::DatasetWriter::Open(dataset_, spec_);
    ASSERT_THAT(writer, IsOk());
    Episode other = MakeSyntheticEpisode(spec_, 7);
    other.robot = "panda";
    ASSERT_THAT(writer->Commit(other), IsOk());
  }
  EXPECT_THAT(ExportLeRobot(dataset_, out_, {}), MessageHas("robot panda, not ur5"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out.partial")) << "it would be in the way of the mended command";

  CampaignSpec odd = SyntheticSpec();
  odd.image_stride = 2;
  auto writer = store::DatasetWriter::Open(folder_ / "odd", odd);
  ASSERT_THAT(writer, IsOk());
  ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(odd, 0)), IsOk());
  EXPECT_THAT(ExportLeRobot(folder_ / "odd", folder_ / "out2", {}), MessageHas("whole number"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out2.partial"));
}

}  // namespace lerobot_test
}  // namespace etude::exports
