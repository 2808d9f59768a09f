// SPDX-License-Identifier: Apache-2.0
// Tests services/store/summary.cc: what is counted of a dataset.
#include "services/store/summary.h"

#include <gmock/gmock.h>

#include <set>

#include "services/episode/tracks.h"
#include "services/store/layout.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store::internal {
namespace summary_test {

Episode Example(std::uint64_t index, int steps) {
  Episode episode = MakeSyntheticEpisode(SyntheticSpec(), index, steps);
  episode.details =
      OrderedJson::parse(R"({"scene": {"draws": 3, "rejected": [{"reason": "touches"}, {"reason": "touches"}]},)"
                         R"( "planned": [{"stage": "reach", "way": "line"}]})");
  return episode;
}

TEST(Summarize, CountsStepsPicturesAndWhatDetailsSay) {
  const Episode episode = Example(1, 52);  // a picture at 0, 5, ..., 50
  const EpisodeSummary summary = Summarize(episode, 22, 12345);
  EXPECT_EQ(summary.task, episode.task);
  EXPECT_EQ(summary.target, episode.target);
  EXPECT_EQ(summary.steps, 52u);
  EXPECT_EQ(summary.samples, 11u);
  EXPECT_EQ(summary.frames, 22u);
  EXPECT_EQ(summary.bytes, 12345u);
  EXPECT_EQ(summary.scene.draws, 3u);
  EXPECT_EQ(summary.scene.rejected.at("touches"), 2u);
  EXPECT_EQ(summary.planned.ways.at("reach").at("line"), 1u);
}

TEST(Summarize, OfAFileIsThatOfItsEpisode) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  {
    auto writer = DatasetWriter::Open(folder / "d", spec);
    ASSERT_THAT(writer, IsOk());
    ASSERT_THAT(writer->Commit(Example(0, 40)), IsOk());
  }
  auto record = DatasetReader::Open(folder / "d")->Read(0);
  ASSERT_THAT(record, IsOk());
  const EpisodeSummary summary = Summarize(*record);
  EXPECT_EQ(summary.frames, 8u);
  EXPECT_EQ(summary.bytes, std::filesystem::file_size(EpisodePath(folder / "d", 0)));
  record->path = folder / "gone";
  EXPECT_EQ(Summarize(*record).bytes, 0u) << "it went away meanwhile";
}

// Adding one by one is the same as counting all, and each sum is that of the episodes.
TEST(Statistics, AreSumsWhateverTheOrder) {
  const CampaignSpec spec = SyntheticSpec();
  std::map<std::uint64_t, EpisodeSummary> episodes;
  std::uint64_t steps = 0, samples = 0, bytes = 0, successes = 0;
  for (std::uint64_t i = 0; i < 12; ++i) {
    EpisodeSummary& episode = episodes[i];
    episode = Summarize(Example(i, 40 + 5 * static_cast<int>(i)), i, 100 * i);
    episode.success = i % 3 != 0;
    episode.outcome = episode.success ? "success" : "timeout";
    steps += episode.steps, samples += episode.samples, bytes += episode.bytes, successes += episode.success ? 1 : 0;
  }
  const OrderedJson all = StatisticsOf(spec, episodes);
  Statistics backwards;
  for (auto it = episodes.rbegin(); it != episodes.rend(); ++it) backwards.Add(spec, it->first, it->second);
  EXPECT_EQ(all, backwards.Json());

  EXPECT_EQ(all["episodes"], 12);
  EXPECT_EQ(all["successes"], successes);
  EXPECT_EQ(all["steps"], steps);
  EXPECT_EQ(all["samples"], samples);
  EXPECT_EQ(all["frames"], 66);
  EXPECT_EQ(all["bytes"], bytes);
  EXPECT_DOUBLE_EQ(all["seconds"].get<double>(), static_cast<double>(steps) / 125);
  EXPECT_EQ(all["outcomes"], (OrderedJson{{"success", 8}, {"timeout", 4}}));
  std::uint64_t in_splits = 0, in_tasks = 0;
  for (const auto& [split, count] : all["splits"].items()) in_splits += count.get<std::uint64_t>();
  for (const auto& [task, count] : all["tasks"].items()) in_tasks += count.get<std::uint64_t>();
  EXPECT_EQ(in_splits, 12u);
  EXPECT_EQ(in_tasks, 12u);
  EXPECT_EQ(all["scenes"]["draws"], 36);
  EXPECT_EQ(all["planned"]["reach"]["times"], 12);
}

TEST(Statistics, OfNothingHaveEveryKeyAndNoShare) {
  const OrderedJson none = StatisticsOf(SyntheticSpec(), {});
  EXPECT_EQ(none["episodes"], 0);
  EXPECT_EQ(none["seconds"], 0.0);
  EXPECT_EQ(none["splits"], (OrderedJson{{"test", 0}, {"train", 0}, {"valid", 0}}));
  EXPECT_FALSE(none["scenes"].contains("first_draw"));
  EXPECT_TRUE(none["tasks"].empty());
}

// Whoever opens the file by this table finds arrays of these shapes: rows times the extent are the numbers there.
TEST(FeatureTable, NamesEveryArrayOnceWithTheShapeThatItHas) {
  const Episode episode = Example(2, 50);
  std::set<std::string> names;
  std::map<std::string, OrderedJson> rows;
  for (const auto& row : FeatureTable(episode)) {
    EXPECT_TRUE(names.insert(row["name"]).second) << row["name"];
    rows[row["name"]] = row;
  }
  VisitTracks(episode, [&](const std::string& name, const Track& track, int) {
    ASSERT_TRUE(rows.contains("control/" + name)) << name;
    const OrderedJson& shape = rows["control/" + name]["shape"];
    ASSERT_EQ(shape.size(), 2u);
    EXPECT_EQ(shape[0], "T");
    EXPECT_EQ(shape[1].get<std::size_t>() * 50, track.values.size()) << name;
  });
  EXPECT_EQ(rows["control/phase"]["dtype"], "uint8");
  EXPECT_EQ(rows["obs/front_image"]["shape"], OrderedJson({"N", 32, 32, 3}));
  EXPECT_EQ(rows["obs/front_image"]["rate_hz"], 25.0);
  EXPECT_EQ(rows["control/eef_pos"]["rate_hz"], 125.0);
  EXPECT_EQ(rows["control/objects/" + episode.target + "/pose"]["shape"][1], 7);
}

TEST(FailuresByOutcome, CountsLinesThatParseAndEachAttemptOnce) {
  const TemporaryFolder folder;
  EXPECT_TRUE(FailuresByOutcome(folder.path()).empty()) << "no such file";
  ASSERT_THAT(
      WriteFileAtomically(folder / kAttempts, std::string_view("{\"index\":1,\"attempt\":0,\"outcome\":\"slip\"}\n"
                                                               "{\"index\":1,\"attempt\":1,\"outcome\":\"slip\"}\n"
                                                               "{\"index\":2,\"attempt\":0,\"outcome\":\"timeout\"}\n"
                                                               "{\"index\":1,\"attempt\":1,\"outcome\":\"slip\"}\n"
                                                               "{\"index\":2,\"outcome\":\"timeout\"}\nnot JSON\n\n"
                                                               "{\"index\":3,\"attempt\":0,\"outcome\":7}\n"
                                                               "{\"index\":4,\"attempt\":0,\"outc")),
      IsOk());
  EXPECT_EQ(FailuresByOutcome(folder.path()), (std::map<std::string, std::uint64_t>{{"slip", 2}, {"timeout", 1}}));
}

}  // namespace summary_test
}  // namespace etude::store::internal
