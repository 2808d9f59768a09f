// SPDX-License-Identifier: Apache-2.0
// Tests services/codec/frames.cc
#include "services/codec/frames.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>

#include "services/codec/deflate.h"
#include "services/core/rng.h"
#include "tests/support/matchers.h"

namespace etude::codec {
namespace frames_test {

using Bytes = std::vector<std::uint8_t>;

// Of a camera that stands still: a noisy ground, and a square that moves a pixel a frame.
std::vector<Bytes> Film(int width, int height, int frames) {
  Rng rng(3);
  const FrameLayout layout{width, height, {}};
  Bytes ground(layout.frame_bytes());
  for (auto& byte : ground) byte = static_cast<std::uint8_t>(100 + rng.Below(16));
  std::vector<Bytes> film(static_cast<std::size_t>(frames), ground);
  for (int k = 0; k < frames; ++k)
    for (int v = height / 2; v < std::min(height, height / 2 + 10); ++v)
      for (int u = k % width; u < std::min(width, k % width + 10); ++u)
        film[static_cast<std::size_t>(k)][static_cast<std::size_t>(3 * (v * width + u))] = 255;
  return film;
}

DeflatedFrames DeflateAll(const FrameLayout& layout, const std::vector<Bytes>& film) {
  FrameDeflater deflater(layout);
  for (const Bytes& frame : film) deflater.Add(frame);
  return deflater.Finish();
}

std::size_t SizeOf(const DeflatedFrames& deflated) {
  std::size_t size = 0;
  for (const auto& stream : deflated.streams) size += stream.size();
  return size;
}

TEST(FrameDeflater, BlocksInflateToTheFramesInAnyShape) {
  for (const auto& [width, height] : {std::pair{20, 11}, {1, 1}, {224, 224}, {5, 300}}) {
    const auto film = Film(width, height, 11);
    for (const ChunkShape chunk : {ChunkShape{1, 0}, ChunkShape{1, 1}, ChunkShape{4, 0}, ChunkShape{11, 0},
                                   ChunkShape{3, (height + 2) / 3}, ChunkShapeFor(width, height)}) {
      const auto [count, shape, streams] = DeflateAll({width, height, chunk}, film);
      EXPECT_EQ(count, film.size());
      const FrameLayout layout{width, height, shape};
      ASSERT_TRUE(layout.IsGood());
      ASSERT_EQ(streams.size(), layout.streams(film.size())) << chunk.frames << " x " << chunk.rows;
      const auto bands = static_cast<std::size_t>(layout.bands()), of_block = static_cast<std::size_t>(shape.frames);
      for (std::size_t block = 0; block < layout.blocks(film.size()); ++block) {
        const std::vector<std::span<const std::uint8_t>> its(
            streams.begin() + static_cast<std::ptrdiff_t>(block * bands),
            streams.begin() + static_cast<std::ptrdiff_t>((block + 1) * bands));
        Bytes frames(layout.block_bytes(), 0x55);
        ASSERT_THAT(InflateBlock(layout, its, frames), IsOk());
        for (std::size_t k = block * of_block; k < (block + 1) * of_block; ++k) {
          const auto frame = std::span(frames).subspan(k % of_block * layout.frame_bytes(), layout.frame_bytes());
          const Bytes expected = k < film.size() ? film[k] : Bytes(layout.frame_bytes(), 0);
          ASSERT_TRUE(std::ranges::equal(frame, expected))
              << width << " " << chunk.frames << " " << chunk.rows << " " << k;
        }
      }
    }
  }
}

TEST(FrameDeflater, AStreamIsTheRowsOfItsFramesOneAfterTheOther) {
  const auto film = Film(20, 11, 5);
  const auto [count, shape, streams] = DeflateAll({20, 11, {2, 4}}, film);
  ASSERT_EQ(streams.size(), 3u * 3u);
  Bytes pixels(2 * 4 * 60);
  ASSERT_THAT(Inflate(streams[4], pixels), IsOk());  // frames 2 and 3, rows 4 to 7
  EXPECT_TRUE(std::ranges::equal(std::span(pixels).first(240), std::span(film[2]).subspan(240, 240)));
  EXPECT_TRUE(std::ranges::equal(std::span(pixels).last(240), std::span(film[3]).subspan(240, 240)));
  ASSERT_THAT(Inflate(streams[8], pixels), IsOk());  // frame 4, rows 8 to 10
  EXPECT_TRUE(std::ranges::equal(std::span(pixels).first(180), std::span(film[4]).last(180)));
  EXPECT_THAT(std::vector(pixels.begin() + 180, pixels.end()), testing::Each(0));
}

TEST(FrameDeflater, OfFewerFramesThanABlockTheBlockIsSmaller) {
  FrameDeflater deflater({20, 11, {6, 4}});
  const auto film = Film(20, 11, 2);
  for (int round = 0; round < 2; ++round) {
    for (const Bytes& frame : film) deflater.Add(frame);
    const auto [count, shape, streams] = deflater.Finish();
    EXPECT_EQ(count, 2u);
    EXPECT_EQ(shape, (ChunkShape{2, 4}));
    EXPECT_EQ(streams.size(), 3u);
  }
  EXPECT_THAT(deflater.Finish().streams, testing::IsEmpty());
}

// What the shape is for: what stands still is stored once a block.
TEST(ChunkShapeFor, MakesAFilmAFractionOfItsFramesOneByOne) {
  const auto film = Film(224, 224, 30);
  const std::size_t whole = SizeOf(DeflateAll({224, 224, {}}, film));
  const std::size_t cut = SizeOf(DeflateAll({224, 224, ChunkShapeFor(224, 224)}, film));
  EXPECT_LT(4 * cut, whole);
  const ChunkShape too_high{6, 224};
  EXPECT_GT(SizeOf(DeflateAll({224, 224, too_high}, film)), whole / 2) << "the frame before is out of reach";
}

TEST(ChunkShapeFor, KeepsABlockWithinTheCacheOfHdf5AndABandWithinReach) {
  EXPECT_EQ(ChunkShapeFor(224, 224), (ChunkShape{6, 32}));
  for (const auto& [width, height] : {std::pair{1, 1},
                                      {16, 16},
                                      {84, 84},
                                      {224, 224},
                                      {264, 264},
                                      {294, 294},
                                      {640, 480},
                                      {2048, 2048},
                                      {4096, 4096},
                                      {4096, 1}}) {
    const FrameLayout layout{width, height, ChunkShapeFor(width, height)};
    EXPECT_TRUE(layout.IsGood()) << width << " " << height;
    if (width == 4096 && height == 4096) {
      EXPECT_TRUE(layout.whole()) << "four of them are too much for a reader";
      continue;
    }
    EXPECT_LE(layout.band_bytes(), 24u << 10);
    EXPECT_GE(layout.chunk.frames, 4);
    if (layout.chunk.frames > 4 || width == 294) {
      EXPECT_LE(layout.stream_bytes() * static_cast<std::size_t>(layout.bands()), 1u << 20);
    }
  }
}

TEST(FrameLayout, RefusesWhatNoReaderShouldTake) {
  for (const FrameLayout& bad :
       {FrameLayout{0, 5, {}}, FrameLayout{5, 0, {}}, FrameLayout{5, 5, {0, 5}}, FrameLayout{5, 5, {1, 6}},
        FrameLayout{5, 5, {1, -1}}, FrameLayout{5, 5, {65, 5}}, FrameLayout{1 << 30, 1 << 30, {64, 1 << 30}},
        FrameLayout{5, INT32_MAX, {1, INT32_MAX}}, FrameLayout{1 << 20, 1 << 20, {64, 1 << 20}},
        FrameLayout{4096, 4096, {2, 64}}, FrameLayout{2000, 2000, {5, 1500}}})
    EXPECT_FALSE(bad.IsGood()) << bad.width << " " << bad.height << " " << bad.chunk.frames << " " << bad.chunk.rows;
  EXPECT_TRUE((FrameLayout{2000, 2000, {5, 1000}}).IsGood());
  EXPECT_TRUE((FrameLayout{5, 5, {64, 5}}).IsGood());
  EXPECT_TRUE((FrameLayout{100'000, 100'000, {}}).IsGood()) << "one frame is as large as it is";
}

TEST(InflateBlock, SaysWhenAStreamIsDamaged) {
  const auto film = Film(20, 11, 4);
  auto [count, shape, streams] = DeflateAll({20, 11, {4, 4}}, film);
  streams[1].resize(streams[1].size() / 2);
  const std::vector<std::span<const std::uint8_t>> its(streams.begin(), streams.end());
  const FrameLayout layout{20, 11, shape};
  Bytes frames(layout.block_bytes());
  EXPECT_THAT(InflateBlock(layout, its, frames), HasCode(Code::kCorrupt));
}

}  // namespace frames_test
}  // namespace etude::codec
