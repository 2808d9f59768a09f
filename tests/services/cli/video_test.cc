// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/video.cc
#include "services/cli/video.h"

#include <gtest/gtest.h>

#include "services/store/dataset.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace {

TEST(WriteVideos, FailuresComeFirstAndTheLimitHolds) {
  TemporaryFolder folder;
  CampaignSpec spec = SyntheticSpec(64, 48);
  spec.mode = "rollout";
  spec.rollout.run = "demo";
  {
    auto writer = store::DatasetWriter::Open(folder / "rollouts", spec);
    ASSERT_TRUE(writer) << writer.error().message;
    for (std::uint64_t i = 0; i < 4; ++i) {
      Episode episode = MakeSyntheticEpisode(spec, i, 25);
      episode.success = i != 2;
      episode.outcome = episode.success ? "success" : "timeout";
      const Status committed = writer->Commit(episode);
      ASSERT_TRUE(committed) << committed.error().message;
    }
  }

  const auto videos = WriteVideos(folder / "rollouts", folder / "videos", 2);

  ASSERT_TRUE(videos) << videos.error().message;
  ASSERT_EQ(videos->size(), 2u);
  EXPECT_EQ((*videos)[0].filename(), "000002-put_down-timeout.mp4");
  EXPECT_EQ((*videos)[1].filename(), "000000-pick-success.mp4");
  for (const auto& video : *videos) {
    const auto bytes = ReadBinaryFile(video).value();
    ASSERT_GT(bytes.size(), 500u);
    EXPECT_EQ(std::string(bytes.begin() + 4, bytes.begin() + 8), "ftyp") << "an mp4 file";
  }
}

}  // namespace
}  // namespace etude::cli
