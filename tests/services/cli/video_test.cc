// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/video.cc
#include "services/cli/video.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>

#include "services/core/file.h"
#include "services/episode/action.h"
#include "services/store/dataset.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace video_test {

// Four rollouts of 64 x 48 pixels, the third of which failed, with a decision at steps 0 and 15.
void WriteRollouts(const Path& folder) {
  CampaignSpec spec = SyntheticSpec(64, 48);
  spec.mode = "rollout";
  spec.rollout.run = "demo";
  auto writer = store::DatasetWriter::Open(folder, spec);
  ASSERT_TRUE(writer) << writer.error().message;
  for (std::uint64_t i = 0; i < 4; ++i) {
    Episode episode = MakeSyntheticEpisode(spec, i, 25);
    episode.success = i != 2;
    episode.outcome = episode.success ? "success" : "timeout";
    for (const int step : {0, 15}) episode.details["decisions"].push_back({{"step", step}, {"checkpoint_step", 7}});
    const Status committed = writer->Commit(episode);
    ASSERT_TRUE(committed) << committed.error().message;
  }
}

void ExpectMp4(const Path& video) {
  const auto bytes = ReadBinaryFile(video).value();
  ASSERT_GT(bytes.size(), 500u);
  EXPECT_EQ(std::string(bytes.begin() + 4, bytes.begin() + 8), "ftyp") << "an mp4 file";
}

policy::Insight ExampleInsight() {
  policy::Insight insight;
  insight.checkpoint_step = 7;
  insight.modules = OrderedJson::parse(R"({"EE2D": {"entity": "ee", "quantity": "pixel", "value": [20, 30]}})");
  insight.waypoints.resize(kWaypoints);
  return insight;
}

TEST(WriteVideos, FailuresComeFirstAndTheLimitHolds) {
  TemporaryFolder folder;
  WriteRollouts(folder / "rollouts");

  const auto videos = WriteVideos(folder / "rollouts", folder / "videos", 2);

  ASSERT_TRUE(videos) << videos.error().message;
  ASSERT_EQ(videos->size(), 2u);
  EXPECT_EQ((*videos)[0].filename(), "000002-put_down-timeout.mp4");
  EXPECT_EQ((*videos)[1].filename(), "000000-pick-success.mp4");
  for (const auto& video : *videos) ExpectMp4(video);
}

// with another policy, say: its index, task and outcome may be those of the one before
TEST(WriteVideos, ARolloutThatWasMadeAnewGetsAnotherVideo) {
  TemporaryFolder folder;
  WriteRollouts(folder / "rollouts");
  const auto first = WriteVideos(folder / "rollouts", folder / "videos", 1);
  ASSERT_TRUE(first) << first.error().message;
  const Path& video = first->at(0);
  ASSERT_TRUE(WriteFileAtomically(video, std::string_view("drawn")));
  ASSERT_TRUE(WriteVideos(folder / "rollouts", folder / "videos", 1));
  EXPECT_EQ(ReadTextFile(video).value(), "drawn") << "what is there stays";
  std::filesystem::last_write_time(video, std::filesystem::last_write_time(video) - std::chrono::hours(1));
  ASSERT_TRUE(WriteVideos(folder / "rollouts", folder / "videos", 1));
  ExpectMp4(video);
}

TEST(WriteVideos, OverlaysHaveNamesOfTheirOwnAndAskForWhatTheyShow) {
  TemporaryFolder folder;
  WriteRollouts(folder / "rollouts");
  ASSERT_TRUE(WriteVideos(folder / "rollouts", folder / "videos", 1));
  std::vector<std::string> asked;
  Overlay overlay{[&](const policy::Question& question) -> Result<policy::Insight> {
                    asked.push_back(question.instruction);
                    return ExampleInsight();
                  },
                  {}};

  const auto videos = WriteVideos(folder / "rollouts", folder / "videos", 1, &overlay);

  ASSERT_TRUE(videos) << videos.error().message;
  ASSERT_EQ(videos->size(), 1u);
  EXPECT_EQ((*videos)[0].filename(), "000002-put_down-timeout-overlay.mp4");
  ExpectMp4((*videos)[0]);
  EXPECT_EQ(asked.size(), 2u) << "of the one rollout that is shown";
  EXPECT_EQ(overlay.tally.Text(), "overlay: 2 of 2 decisions");
  EXPECT_TRUE(std::filesystem::exists(folder / "videos" / "000002-put_down-timeout.mp4")) << "the plain one stays";

  // what is there is not made again, and not asked for
  ASSERT_TRUE(WriteVideos(folder / "rollouts", folder / "videos", 1, &overlay));
  EXPECT_EQ(asked.size(), 2u);
}

// before, plain videos had an overlay's names for good, because they were there
TEST(WriteVideos, WhereNobodyAnswersThereIsNoOverlay) {
  TemporaryFolder folder;
  WriteRollouts(folder / "rollouts");
  bool answers = false;
  Overlay overlay{[&](const policy::Question&) -> Result<policy::Insight> {
                    if (!answers) return Fail(Code::kUnavailable, "nobody serves");
                    return ExampleInsight();
                  },
                  {}};
  const auto none = WriteVideos(folder / "rollouts", folder / "videos", 2, &overlay);
  ASSERT_TRUE(none) << none.error().message;
  EXPECT_TRUE(none->empty());
  EXPECT_TRUE(std::filesystem::is_empty(folder / "videos"));
  answers = true;
  EXPECT_EQ(WriteVideos(folder / "rollouts", folder / "videos", 2, &overlay)->size(), 2u);
}

TEST(WriteVideos, ADecisionWithoutAnInsightCostsNoFrame) {
  TemporaryFolder folder;
  WriteRollouts(folder / "rollouts");
  int question = 0;
  Overlay overlay{[&](const policy::Question&) -> Result<policy::Insight> {
                    if (++question % 2 == 1) return Fail(Code::kUnavailable, "too late");
                    return ExampleInsight();
                  },
                  {}};
  const auto videos = WriteVideos(folder / "rollouts", folder / "videos", 4, &overlay);
  ASSERT_TRUE(videos) << videos.error().message;
  ASSERT_EQ(videos->size(), 4u);
  for (const auto& video : *videos) ExpectMp4(video);
  EXPECT_EQ(overlay.tally.Text(), "overlay: 4 of 8 decisions; without: 4 without an answer (too late)");
}

}  // namespace video_test
}  // namespace etude::cli
