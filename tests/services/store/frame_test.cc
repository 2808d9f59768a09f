// SPDX-License-Identifier: Apache-2.0
// Tests services/store/frame.cc
#include "services/codec/frame.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <fstream>
#include <thread>

#include "services/core/rng.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace frame_test {

using Bytes = std::vector<std::uint8_t>;

// smooth colours with a little noise
Bytes Pixels(int seed, std::size_t size = 48 * 48 * 3) {
  Rng rng(static_cast<std::uint64_t>(seed));
  Bytes pixels(size);
  for (std::size_t i = 0; i < size; ++i) pixels[i] = static_cast<std::uint8_t>(i / 50 + rng.Below(4));
  return pixels;
}

TEST(Frame, InflatesToWhatWasDeflatedAndIsDeterministic) {
  for (const std::size_t size : {std::size_t{1}, std::size_t{300}, std::size_t{224 * 224 * 3}}) {
    const Bytes pixels = Pixels(1, size);
    const Bytes stream = codec::DeflateFrame(pixels);
    Bytes back(size);

    ASSERT_THAT(codec::InflateFrame(stream, back), IsOk());
    EXPECT_EQ(back, pixels);
    EXPECT_EQ(stream, codec::DeflateFrame(pixels));
  }
}

TEST(Frame, RefusesEveryOtherSizeAndEveryFlippedBit) {
  const Bytes pixels = Pixels(2, 600);
  const Bytes stream = codec::DeflateFrame(pixels);
  for (const std::size_t size : {0, 599, 601}) {
    Bytes back(size);
    EXPECT_THAT(codec::InflateFrame(stream, back), HasCode(Code::kCorrupt)) << size;
  }
  Bytes longer = stream;
  longer.push_back(0);
  Bytes back(600);
  EXPECT_THAT(codec::InflateFrame(longer, back), HasCode(Code::kCorrupt));
  for (std::size_t size = 0; size < stream.size(); ++size)
    ASSERT_THAT(codec::InflateFrame(std::span(stream).first(size), back), HasCode(Code::kCorrupt)) << size;
  for (std::size_t bit = 0; bit < 8 * stream.size(); ++bit) {
    Bytes flipped = stream;
    flipped[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
    // the format leaves bits without meaning; what inflates must then be the same picture
    if (codec::InflateFrame(flipped, back)) {
      ASSERT_EQ(back, pixels) << bit;
    }
  }
}

struct FrameFile {
  TemporaryFolder folder;
  Path path = folder / "frames";
  std::vector<FrameLocation> locations;

  explicit FrameFile(int count) {
    std::ofstream file(path, std::ios::binary);
    std::uint64_t offset = 0;
    for (int k = 0; k < count; ++k) {
      const Bytes stream = codec::DeflateFrame(Pixels(k));
      file.write(reinterpret_cast<const char*>(stream.data()), static_cast<std::streamsize>(stream.size()));
      locations.push_back({offset, static_cast<std::uint32_t>(stream.size())});
      offset += stream.size();
    }
  }
};

TEST(FrameReader, RefusesWrongLocations) {
  const FrameFile file(3);
  Bytes pixels(48 * 48 * 3);
  const auto [offset, size] = file.locations[1];

  EXPECT_THAT(FrameReader::Read(file.path, {offset, size}, pixels), IsOk());
  EXPECT_THAT(FrameReader::Read(file.path, {offset + 1, size}, pixels), HasCode(Code::kCorrupt));
  EXPECT_THAT(FrameReader::Read(file.path, {offset, size - 1}, pixels), HasCode(Code::kCorrupt));
  EXPECT_THAT(FrameReader::Read(file.path, {1u << 30, size}, pixels), HasCode(Code::kCorrupt));
  EXPECT_THAT(FrameReader::Read(file.path, {0, UINT32_MAX}, pixels), HasCode(Code::kCorrupt));
  EXPECT_THAT(FrameReader::Read(file.path, {UINT64_MAX - 5, size}, pixels), HasCode(Code::kCorrupt));
  EXPECT_THAT(FrameReader::Read(file.folder / "none", {0, size}, pixels), HasCode(Code::kNotFound));
}

TEST(FrameReader, ReadsFromManyThreadsAtOnce) {
  const FrameFile file(16);
  std::vector<Bytes> expected;
  for (int k = 0; k < 16; ++k) expected.push_back(Pixels(k));
  std::atomic<int> wrong{0};
  {
    std::vector<std::jthread> threads;
    for (int t = 0; t < 8; ++t)
      threads.emplace_back([&, t] {
        Rng rng(static_cast<std::uint64_t>(t));
        Bytes pixels(48 * 48 * 3);
        for (int i = 0; i < 300; ++i) {
          const std::size_t k = rng.Below(16);
          const Status read = FrameReader::Read(file.path, file.locations[k], pixels);
          if (!read || pixels != expected[k]) ++wrong;
        }
      });
  }
  EXPECT_EQ(wrong, 0);
}

}  // namespace frame_test
}  // namespace etude::store
