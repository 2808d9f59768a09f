// SPDX-License-Identifier: Apache-2.0
// Tests services/episode/episode.cc and the synthetic episodes that other tests stand on
#include "services/episode/episode.h"

#include <gtest/gtest.h>

#include "services/codec/frame.h"
#include "services/episode/codec.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"

namespace etude {
namespace episode_test {

TEST(Episode, FindsObjectsByName) {
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 0);

  ASSERT_NE(episode.FindObject("milk"), nullptr);
  EXPECT_EQ(episode.FindObject("milk")->name, "milk");
  EXPECT_EQ(episode.FindObject("unicorn"), nullptr);
}

TEST(Track, CountsRowsAndGivesThem) {
  Track track;
  EXPECT_EQ(track.rows(), 0);
  track.columns = 2;
  track.Push(std::vector<float>{1, 2});
  track.Push(std::vector<float>{3, 4});

  EXPECT_EQ(track.rows(), 2);
  EXPECT_EQ(track.row(1)[0], 3);
}

TEST(SyntheticEpisode, IsValidAndPureInSpecAndIndex) {
  const CampaignSpec spec = SyntheticSpec();
  for (std::uint64_t index = 0; index < 5; ++index) {
    const Episode episode = MakeSyntheticEpisode(spec, index);

    EXPECT_THAT(ValidateEpisode(episode), IsOk());
    EXPECT_EQ(EncodeEpisode(episode), EncodeEpisode(MakeSyntheticEpisode(spec, index)));
  }
  EXPECT_NE(EncodeEpisode(MakeSyntheticEpisode(spec, 0)), EncodeEpisode(MakeSyntheticEpisode(spec, 1)));
}

TEST(SyntheticEpisode, ShowsTheTargetWhereItsPixelSays) {
  const CampaignSpec spec = SyntheticSpec(96, 64);
  int hidden = 0;
  for (std::uint64_t index = 0; index < 8; ++index) {
    const Episode episode = MakeSyntheticEpisode(spec, index);
    std::vector<std::uint8_t> pixels(96 * 64 * 3);
    ASSERT_THAT(codec::InflateFrame(episode.cameras[0].frames[0], pixels), IsOk());

    const auto uv = episode.FindObject(episode.target)->pixel.row(0);
    ASSERT_TRUE(uv[0] > 0 && uv[0] < 96 && uv[1] > 0 && uv[1] < 64) << uv[0] << " " << uv[1];
    const auto* at = &pixels[3 * (static_cast<int>(uv[1]) * 96 + static_cast<int>(uv[0]))];
    const auto color = SyntheticColor(episode.target);
    hidden += std::equal(color.begin(), color.end(), at) ? 0 : 1;
  }

  EXPECT_LE(hidden, 2);  // the hand or a nearer object may stand before it
}

}  // namespace episode_test
}  // namespace etude
