// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/datasets.cc and episodes.cc: figures of a dataset against a count of its episodes.
#include <gmock/gmock.h>

#include <cmath>
#include <cstring>
#include <map>
#include <set>

#include "dashboard/server/api/episode_filter.h"
#include "services/episode/tracks.h"
#include "services/store/edit.h"
#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/support/matchers.h"

namespace etude::api {
namespace datasets_test {

class DatasetsTest : public ApiFixture {
 protected:
  // Episodes of 20, 27, 34, ... steps: a dataset that nobody has looked at.
  void WriteUneven(const std::string& name, std::uint64_t episodes = 10) {
    auto writer = store::DatasetWriter::Open(lab_.root() / name, spec_);
    ASSERT_THAT(writer, IsOk());
    for (std::uint64_t i = 0; i < episodes; ++i)
      ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec_, i, 20 + 7 * static_cast<int>(i))), IsOk());
  }
  std::vector<Episode> ReadAll(const std::string& name) {
    std::vector<Episode> episodes;
    const auto reader = store::DatasetReader::Open(lab_.root() / name).value();
    const std::vector<std::uint64_t> indices = reader.List().value();
    for (const auto index : indices) episodes.push_back(reader.ReadWhole(index).value());
    return episodes;
  }
  OrderedJson Known(const std::string& address) {
    (void)GetJson(kPrefix + address);
    RunLater();
    return GetJson(kPrefix + address);
  }

  CampaignSpec spec_ = SyntheticSpec();
};

template <class T>
std::vector<T> NumbersOf(const store::Tensor& tensor) {
  std::vector<T> numbers(tensor.data.size() / sizeof(T));
  std::memcpy(numbers.data(), tensor.data.data(), tensor.data.size());
  return numbers;
}

TEST_F(DatasetsTest, TheSummaryCountsByWorkerWhatTheJournalSays) {
  {
    auto writer = store::DatasetWriter::Open(lab_.root() / "shared", spec_);
    ASSERT_THAT(writer, IsOk());
    for (std::uint64_t i = 0; i < 5; ++i)
      ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec_, i, 20), {.worker = i < 2 ? "lab-7-1" : "lab-9-1"}),
                  IsOk());
  }
  EXPECT_EQ(Known("/datasets/lab.shared/summary")["workers"], (OrderedJson{{"lab-7-1", 2}, {"lab-9-1", 3}}));
  EXPECT_EQ(Known("/datasets/lab.shared/summary?worker=lab-9-1")["total"], 3);
}

TEST_F(DatasetsTest, TheSummaryCountsWhatTheFilesSay) {
  WriteUneven("uneven");
  const auto summary = Known("/datasets/lab.uneven/summary");
  std::map<std::string, int> tasks, targets, words;
  std::map<std::pair<std::string, std::string>, int> cells;
  for (const auto& episode : ReadAll("uneven")) {
    ++tasks[episode.task], ++targets[episode.target], ++cells[{episode.task, episode.target}];
    for (const auto& word : WordsOf(episode.instruction)) ++words[word];
  }
  EXPECT_EQ(summary["total"], 10);
  EXPECT_EQ(summary["known"], 10);
  EXPECT_EQ(summary["tasks"], OrderedJson(tasks));
  EXPECT_EQ(summary["targets"], OrderedJson(targets));
  EXPECT_EQ(summary["outcomes"], (OrderedJson{{"success", 10}}));
  std::map<std::string, int> counted;
  for (const auto& row : summary["words"]) counted[row["word"].get<std::string>()] = row["count"].get<int>();
  EXPECT_EQ(counted, words);
  double expected = 0;
  for (const auto& cell : summary["matrix"]) {
    const std::pair key(cell["task"].get<std::string>(), cell["target"].get<std::string>());
    EXPECT_EQ(cell["count"], cells[key]) << cell.dump();
    expected += cell["expected"].get<double>();
  }
  EXPECT_NEAR(expected, static_cast<double>(spec_.episodes), 1e-9) << "what the spec asks for, in all";
  EXPECT_EQ(summary["matrix"].size(), spec_.tasks.size() * spec_.objects.size());
}

TEST_F(DatasetsTest, EveryLengthIsInItsBin) {
  WriteUneven("uneven", 20);  // 20 to 153 steps
  const auto lengths = Known("/datasets/lab.uneven/summary")["lengths"];
  const auto& edges = lengths["edges_steps"];
  const auto& counts = lengths["counts"];
  ASSERT_EQ(edges.size(), counts.size() + 1);
  EXPECT_EQ(edges.front(), 20.0);
  EXPECT_GT(edges.back().get<double>(), 153.0);
  int all = 0;
  for (std::size_t bin = 0; bin < counts.size(); ++bin) {
    int inside = 0;
    for (int i = 0; i < 20; ++i) {
      const int steps = 20 + 7 * i;
      inside += steps >= edges[bin].get<double>() && steps < edges[bin + 1].get<double>() ? 1 : 0;
    }
    EXPECT_EQ(counts[bin], inside) << bin;
    all += counts[bin].get<int>();
  }
  EXPECT_EQ(all, 20);
}

TEST_F(DatasetsTest, FiguresOfAPartAreOfThatPart) {
  WriteUneven("uneven");
  (void)Known("/datasets/lab.uneven/summary");
  const auto pick = GetJson(kPrefix + "/datasets/lab.uneven/summary?task=pick");
  int picks = 0;
  for (const auto& episode : ReadAll("uneven")) picks += episode.task == "pick" ? 1 : 0;
  EXPECT_EQ(pick["total"], picks);
  EXPECT_EQ(pick["tasks"], (OrderedJson{{"pick", picks}}));
  for (const auto& cell : pick["matrix"]) EXPECT_TRUE(cell["expected"].is_null()) << "the spec says nothing of a part";
  EXPECT_TRUE(GetJson(kPrefix + "/datasets/lab.uneven/summary?task=none")["lengths"]["counts"].empty());
}

TEST_F(DatasetsTest, ListsAreSortedByAnyColumnBothWays) {
  WriteUneven("uneven");
  (void)Known("/datasets/lab.uneven/episodes");
  for (const char* key : {"index", "steps", "t", "bytes", "draws", "odd"})
    for (const char* sign : {"", "-"}) {
      const auto list = GetJson(kPrefix + "/datasets/lab.uneven/episodes?sort=" + sign + key);
      const auto& column = list["columns"][key];
      ASSERT_EQ(column.size(), 10u) << key;
      for (std::size_t i = 1; i < column.size(); ++i) {
        if (!column[i].is_number() || !column[i - 1].is_number()) continue;
        const double step = column[i].get<double>() - column[i - 1].get<double>();
        EXPECT_TRUE(*sign == '-' ? step <= 0 : step >= 0) << sign << key << column.dump();
      }
    }
  EXPECT_EQ(Get(kPrefix + "/datasets/lab.uneven/episodes?sort=-").status, 400);
}

TEST_F(DatasetsTest, StagesCoverEveryStepOnce) {
  const auto json = GetJson(kPrefix + "/datasets/lab.data/episodes/1");
  const auto reader = store::DatasetReader::Open(lab_.root() / "data").value();
  const Episode episode = reader.ReadWhole(1).value();
  std::size_t at = 0;
  for (const auto& stage : json["stages"]) {
    EXPECT_EQ(stage["from"], at);
    for (std::size_t t = at; t < stage["to"].get<std::size_t>(); ++t)
      ASSERT_EQ(episode.stage_names[episode.phase[t]], stage["name"]) << t;
    at = stage["to"];
  }
  EXPECT_EQ(at, episode.phase.size());
  EXPECT_TRUE(json["unsupervised"].empty());
  EXPECT_EQ(json["previous"], 0);
  EXPECT_EQ(json["next"], 2);
  EXPECT_EQ(json["duration_s"], static_cast<double>(kSteps) / 125);
  std::set<std::string> names;
  for (const auto& track : json["tracks"]) {
    EXPECT_EQ(track["labels"].size(), track["columns"].get<std::size_t>()) << track.dump();
    names.insert(track["name"]);
  }
  VisitTracks(episode, [&](const std::string& name, const Track&, int) { EXPECT_TRUE(names.contains(name)) << name; });
}

// what a disturbance drives is marked, and a pixel behind the camera hides no number of its bucket
TEST_F(DatasetsTest, SpansWithoutSupervisionAndPixelsThatAreNoNumbersAreShown) {
  Episode episode = MakeSyntheticEpisode(spec_, 0, 40);
  for (const int t : {0, 1, 7, 8, 9, 39}) episode.supervise[static_cast<std::size_t>(t)] = 0;
  for (const int t : {4, 5, 6, 11}) episode.eef_pixel.values[static_cast<std::size_t>(2 * t)] = NAN;
  {
    auto writer = store::DatasetWriter::Open(lab_.root() / "odd", spec_);
    ASSERT_THAT(writer, IsOk());
    ASSERT_THAT(writer->Commit(episode), IsOk());
  }
  const auto json = GetJson(kPrefix + "/datasets/lab.odd/episodes/0");
  EXPECT_EQ(json["unsupervised"], OrderedJson::parse(R"([{"from":0,"to":2},{"from":7,"to":10},{"from":39,"to":40}])"));
  EXPECT_TRUE(json["previous"].is_null());
  EXPECT_TRUE(json["next"].is_null());

  const auto arrays = GetArrays(kPrefix + "/datasets/lab.odd/episodes/0/tracks?names=eef_pixel,supervise&points=4");
  const auto low = NumbersOf<float>(arrays.tensors.at("eef_pixel/min"));
  ASSERT_EQ(low.size(), 8u);
  for (int bucket = 0; bucket < 4; ++bucket) {
    float least = INFINITY;
    for (int t = 10 * bucket; t < 10 * bucket + 10; ++t)
      if (const float u = episode.eef_pixel.row(t)[0]; !std::isnan(u)) least = std::min(least, u);
    EXPECT_EQ(low[static_cast<std::size_t>(2 * bucket)], least) << bucket;
  }
  const auto begins = NumbersOf<std::int32_t>(arrays.tensors.at("step"));
  EXPECT_EQ(begins, (std::vector<std::int32_t>{0, 10, 20, 30}));
  const auto last = NumbersOf<std::uint8_t>(arrays.tensors.at("supervise/last"));
  EXPECT_EQ(last, (std::vector<std::uint8_t>{0, 1, 1, 0}));
}

TEST_F(DatasetsTest, WindowsOfTracksEndWhereTheEpisodeDoes) {
  const std::string base = kPrefix + "/datasets/lab.data/episodes/1/tracks?names=eef_pos";
  const auto whole = NumbersOf<float>(GetArrays(base).tensors.at("eef_pos"));
  const auto part = GetArrays(base + "&from=40&to=99999");
  EXPECT_EQ(part.metadata.at("to"), std::to_string(kSteps));
  const auto tail = NumbersOf<float>(part.tensors.at("eef_pos"));
  EXPECT_EQ(tail, std::vector<float>(whole.begin() + 3 * 40, whole.end()));
  EXPECT_TRUE(NumbersOf<float>(GetArrays(base + "&from=7&to=3").tensors.at("eef_pos")).empty());
  EXPECT_EQ(Get(base + "&from=51").status, 400);
  EXPECT_EQ(Get(base + "&points=1").status, 400);
}

// before, it was a campaign that had died on its way to all that the spec asks for, and the newest one at that
TEST_F(DatasetsTest, ACopyOfSomeEpisodesIsFinished) {
  ASSERT_THAT(store::CopyEpisodes(lab_.root() / "data", {1, 4}, lab_.root() / "some", Leftover::kRefuse), IsOk());
  const auto json = GetJson(kPrefix + "/datasets/lab.some");
  EXPECT_EQ(json["state"], "finished");
  EXPECT_EQ(json["episodes"], 2);
  EXPECT_EQ(json["total"], 2);
  const auto campaign = GetJson(kPrefix + "/campaigns/lab.some");
  EXPECT_EQ(campaign["status"]["total"], 2);
  EXPECT_EQ(campaign["status"]["given_up"], 0);
  const auto cells = GetArrays(kPrefix + "/campaigns/lab.some/cells").tensors.at("cells").data;
  EXPECT_EQ(cells, (std::vector<std::uint8_t>{0, 1, 0, 0, 1})) << "its episodes keep their indices";
  const auto summary = GetJson(kPrefix + "/datasets/lab.some/summary");
  for (const auto& cell : summary["matrix"]) EXPECT_TRUE(cell["expected"].is_null()) << "of a part nothing is expected";
  EXPECT_GT(GetJson(kPrefix + "/datasets/lab.data")["total"], 6) << "its original goes on";
}

}  // namespace datasets_test
}  // namespace etude::api
