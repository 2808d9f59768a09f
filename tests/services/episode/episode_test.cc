// SPDX-License-Identifier: Apache-2.0
// Tests services/episode/episode.cc and the synthetic episodes that other tests stand on
#include "services/episode/episode.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "services/episode/codec.h"
#include "services/episode/frame_cursor.h"
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
    FrameCursor frames(episode);
    const auto pixels = frames.Frame(0);
    ASSERT_THAT(pixels, IsOk());

    const auto uv = episode.FindObject(episode.target)->pixel.row(0);
    ASSERT_TRUE(uv[0] > 0 && uv[0] < 96 && uv[1] > 0 && uv[1] < 64) << uv[0] << " " << uv[1];
    const auto* at = &(*pixels)[3 * (static_cast<int>(uv[1]) * 96 + static_cast<int>(uv[0]))];
    const auto color = SyntheticColor(episode.target);
    hidden += std::equal(color.begin(), color.end(), at) ? 0 : 1;
  }

  EXPECT_LE(hidden, 2);  // the hand or a nearer object may stand before it
}

TEST(FrameCursor, GivesTheSameFramesInAnyOrderHoweverTheyAreCut) {
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(20, 11), 3, 50);
  const Episode whole = Recut(episode, {1, 0}), small = Recut(episode, {3, 4}), odd = Recut(episode, {4, 11});
  EXPECT_EQ(whole.cameras[0].streams.size(), 10u);
  EXPECT_EQ(small.cameras[0].streams.size(), 4u * 3u);
  EXPECT_EQ(odd.cameras[0].streams.size(), 3u);
  FrameCursor expected(whole);
  ASSERT_EQ(expected.size(), 10u);
  for (const Episode* cut : {&episode, &small, &odd}) {
    EXPECT_THAT(ValidateEpisode(*cut), IsOk());
    FrameCursor frames(*cut);
    ASSERT_EQ(frames.size(), 10u);
    for (const std::size_t k : {0, 1, 2, 3, 9, 8, 0, 5, 4, 7, 6}) {
      const auto frame = frames.Frame(k), wanted = expected.Frame(k);
      ASSERT_THAT(frame, IsOk());
      EXPECT_TRUE(std::ranges::equal(*frame, *wanted)) << k;
    }
  }
}

TEST(FrameCursor, ADamagedStreamSpoilsItsBlockAlone) {
  Episode episode = Recut(MakeSyntheticEpisode(SyntheticSpec(20, 12), 3, 50), {4, 6});
  episode.cameras[0].streams[3] = {1, 2, 3};  // the lower band of the second block
  FrameCursor frames(episode);
  for (const std::size_t k : {0, 3, 8, 9}) EXPECT_THAT(frames.Frame(k), IsOk()) << k;
  for (const std::size_t k : {4, 5, 7}) EXPECT_THAT(frames.Frame(k), HasCode(Code::kCorrupt)) << k;
  EXPECT_THAT(frames.Frame(4), MessageHas("camera front frame 4"));
  EXPECT_THAT(frames.Frame(2), IsOk()) << "what failed is not taken for held";
}

}  // namespace episode_test
}  // namespace etude
