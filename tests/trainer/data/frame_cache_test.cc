// SPDX-License-Identifier: Apache-2.0
// Tests trainer/data/frame_cache.cc
#include "trainer/data/frame_cache.h"

#include <gtest/gtest.h>

#include <set>
#include <thread>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "tests/trainer/data/synthetic_dataset.h"

namespace etude::data {
namespace frame_cache_test {

constexpr Region kRegion{4, 6, 20, 24};
constexpr std::size_t kUnlimited = 1u << 30;

class Frames : public testing::Test {
 protected:
  void SetUp() override {
    AddSyntheticEpisodes(folder_ / "d", SyntheticSpec(), 0, 8);
    auto dataset = Dataset::Open(folder_ / "d");
    ASSERT_THAT(dataset, IsOk());
    ASSERT_THAT((*dataset)->Refresh(), IsOk());
    episodes_ = (*dataset)->snapshot()->episodes();
    ASSERT_EQ(episodes_.size(), 8u);
  }
  // The region of a frame, read and cut without a cache.
  std::vector<std::uint8_t> Reference(const EpisodeEntry& entry, std::uint32_t frame) const {
    std::vector<std::uint8_t> region(kRegion.bytes());
    store::FrameReader frames(entry.record.path, entry.record.frames[0]);
    const auto whole = frames.Read(frame);
    EXPECT_THAT(whole, IsOk());
    if (whole) {
      EXPECT_THAT(codec::CropPicture(*whole, 32, 32, kRegion, region), IsOk());
    }
    return region;
  }
  std::vector<std::uint8_t> Cached(FrameCache& cache, const EpisodeEntry& entry, std::uint32_t frame) {
    const auto pixels = cache.Get(entry, frame, scratch_);
    EXPECT_THAT(pixels, IsOk());
    return pixels ? std::vector(*pixels, *pixels + kRegion.bytes()) : std::vector<std::uint8_t>{};
  }
  static std::uint32_t CountOf(const EpisodeEntry& entry) {
    return static_cast<std::uint32_t>(entry.record.frames[0].size());
  }

  TemporaryFolder folder_;
  std::vector<std::shared_ptr<const EpisodeEntry>> episodes_;
  FrameScratch scratch_;
};

// More frames than fit into one block, so that blocks are added while others are in use.
TEST_F(Frames, AreTheRegionOfThePictureEachTime) {
  FrameCache cache(kRegion, kUnlimited);
  std::size_t frames = 0;
  for (int round = 0; round < 2; ++round)
    for (const auto& entry : episodes_)
      for (std::uint32_t frame = 0; frame < CountOf(*entry); ++frame) {
        ASSERT_EQ(Cached(cache, *entry, frame), Reference(*entry, frame)) << entry->index << " " << frame;
        frames += round == 0;
      }
  ASSERT_GT(frames, 64u);
  EXPECT_EQ(cache.misses(), 8u) << "an episode is one block here";
  EXPECT_EQ(cache.hits(), 2 * frames - 8);
  EXPECT_EQ(cache.bytes(), frames * kRegion.bytes());
}

TEST_F(Frames, OfTwoFoldersAreNotMixedUp) {
  CampaignSpec other = SyntheticSpec();
  other.seed += 1;
  AddSyntheticEpisodes(folder_ / "e", other, 0, 8);
  const auto both = Dataset::Open(std::vector<Path>{folder_ / "d", folder_ / "e"});
  ASSERT_THAT(both, IsOk());
  ASSERT_THAT((*both)->Refresh(), IsOk());
  FrameCache cache(kRegion, kUnlimited);
  const auto snapshot = (*both)->snapshot();
  for (int round = 0; round < 2; ++round)
    for (const auto& entry : snapshot->episodes())
      ASSERT_EQ(Cached(cache, *entry, 0), Reference(*entry, 0)) << entry->folder << " " << entry->index;
  EXPECT_EQ(cache.misses(), 16u);
}

TEST_F(Frames, AreReadOnceWithTheirBlock) {
  FrameCache cache(kRegion, kUnlimited);
  const auto first = cache.Get(*episodes_[0], 3, scratch_);
  ASSERT_THAT(first, IsOk());
  std::filesystem::remove(episodes_[0]->record.path);
  const auto again = cache.Get(*episodes_[0], 3, scratch_);
  ASSERT_THAT(again, IsOk());
  EXPECT_EQ(*again, *first);
  EXPECT_THAT(cache.Get(*episodes_[0], 4, scratch_), IsOk());
  EXPECT_EQ(cache.misses(), 1u);
  std::filesystem::remove(episodes_[1]->record.path);
  EXPECT_THAT(cache.Get(*episodes_[1], 4, scratch_), HasCode(Code::kNotFound));
}

TEST_F(Frames, BeyondTheLimitAreDecodedEachTimeAndThoseThatAreKeptStay) {
  FrameCache cache(kRegion, 2 * kRegion.bytes() + 1);
  const EpisodeEntry& entry = *episodes_[0];
  for (int round = 0; round < 2; ++round)
    for (std::uint32_t frame = 0; frame < 4; ++frame) EXPECT_EQ(Cached(cache, entry, frame), Reference(entry, frame));
  EXPECT_EQ(cache.bytes(), 2 * kRegion.bytes());
  EXPECT_EQ(cache.hits(), 3u) << "the second came with the first, and both are there in the second round";
  EXPECT_EQ(cache.misses(), 5u);
  const auto pixels = cache.Get(entry, 3, scratch_);
  ASSERT_THAT(pixels, IsOk());
  EXPECT_EQ(*pixels, scratch_.region.data()) << "valid until the scratch is used again";
}

// Blocks of 16 frames here: three and a piece.
TEST_F(Frames, OfSeveralBlocksComeBlockByBlock) {
  CampaignSpec spec = SyntheticSpec();
  spec.image_stride = 1;
  AddSyntheticEpisodes(folder_ / "long", spec, 0, 1);
  const auto dataset = Dataset::Open(folder_ / "long");
  ASSERT_THAT(dataset, IsOk());
  ASSERT_THAT((*dataset)->Refresh(), IsOk());
  const auto snapshot = (*dataset)->snapshot();
  const EpisodeEntry& entry = *snapshot->episodes().at(0);
  ASSERT_EQ(entry.record.frames[0].layout.chunk.frames, 16);
  ASSERT_EQ(CountOf(entry), 50u);
  FrameCache cache(kRegion, 21 * kRegion.bytes());
  std::uint64_t misses = 0;
  const auto expect = [&](std::uint32_t frame, std::uint64_t missed) {
    EXPECT_EQ(Cached(cache, entry, frame), Reference(entry, frame)) << frame;
    EXPECT_EQ(cache.misses(), misses += missed) << frame;
  };
  expect(49, 1);  // the last block has two frames
  expect(48, 0);
  EXPECT_EQ(cache.bytes(), 2 * kRegion.bytes());
  expect(20, 1);
  for (std::uint32_t frame = 16; frame < 32; ++frame) expect(frame, 0);
  expect(47, 1);  // room for three of its sixteen
  for (const std::uint32_t frame : {32, 33, 34}) expect(frame, 0);
  expect(35, 1);
  EXPECT_EQ(cache.bytes(), 21 * kRegion.bytes());
}

TEST_F(Frames, OfARegionThatDoesNotFitAreRefusedWithTheNumbers) {
  FrameCache cache({20, 0, 13, 32}, kUnlimited);
  const auto pixels = cache.Get(*episodes_[0], 0, scratch_);
  EXPECT_THAT(pixels, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(pixels, MessageHas("13x32 px at (20, 0) does not fit pictures of 32x32 px"));
  EXPECT_EQ(cache.bytes(), 0u);
}

TEST_F(Frames, ThatCannotBeReadTakeNoRoomAndMayBeAskedForAgain) {
  FrameCache cache(kRegion, kUnlimited);
  const Path path = episodes_[0]->record.path, aside = folder_ / "aside";
  std::filesystem::rename(path, aside);
  EXPECT_FALSE(cache.Get(*episodes_[0], 0, scratch_));
  EXPECT_EQ(cache.bytes(), 0u);
  std::filesystem::rename(aside, path);
  EXPECT_EQ(Cached(cache, *episodes_[0], 0), Reference(*episodes_[0], 0));
}

TEST_F(Frames, AreTheSameForThreadsThatAskAtOnce) {
  FrameCache cache(kRegion, kUnlimited);
  const EpisodeEntry& entry = *episodes_[0];
  const std::uint32_t count = CountOf(entry);
  constexpr int kThreads = 4, kRounds = 50;
  std::vector<std::vector<const std::uint8_t*>> seen(kThreads);
  {
    std::vector<std::jthread> threads;
    for (int thread = 0; thread < kThreads; ++thread)
      threads.emplace_back([&, thread] {
        FrameScratch scratch;
        for (int round = 0; round < kRounds; ++round)
          for (std::uint32_t frame = 0; frame < count; ++frame)
            seen[thread].push_back(cache.Get(entry, frame, scratch).value_or(nullptr));
      });
  }
  for (std::uint32_t frame = 0; frame < count; ++frame) {
    std::set<const std::uint8_t*> places;
    for (const auto& pointers : seen)
      for (std::size_t at = frame; at < pointers.size(); at += count) places.insert(pointers[at]);
    ASSERT_EQ(places.size(), 1u) << "one copy is handed out, whoever decoded first";
    ASSERT_NE(*places.begin(), nullptr);
    EXPECT_EQ(std::vector(*places.begin(), *places.begin() + kRegion.bytes()), Reference(entry, frame));
  }
  EXPECT_EQ(cache.hits() + cache.misses(), static_cast<std::uint64_t>(kThreads * kRounds) * count);
}

}  // namespace frame_cache_test
}  // namespace etude::data
