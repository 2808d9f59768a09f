// SPDX-License-Identifier: Apache-2.0
// Tests services/store/frame_reader.cc
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <fstream>
#include <thread>

#include "services/codec/frames.h"
#include "services/core/rng.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace frame_reader_test {

using Bytes = std::vector<std::uint8_t>;

constexpr codec::FrameLayout kLayout{20, 12, {3, 5}};

Bytes Pixels(std::size_t seed) {
  Rng rng(seed);
  Bytes pixels(kLayout.frame_bytes());
  for (std::size_t i = 0; i < pixels.size(); ++i) pixels[i] = static_cast<std::uint8_t>(i / 50 + rng.Below(4));
  return pixels;
}

// Streams one after the other, behind each so many bytes that belong to nobody.
struct FrameFile {
  TemporaryFolder folder;
  Path path = folder / "frames";
  StoredFrames frames{kLayout, 0, {}};

  explicit FrameFile(std::size_t count, std::size_t gap = 0) {
    codec::FrameDeflater deflater(kLayout);
    for (std::size_t k = 0; k < count; ++k) deflater.Add(Pixels(k));
    std::ofstream file(path, std::ios::binary);
    std::uint64_t offset = 0;
    for (const Bytes& stream : deflater.Finish().streams) {
      file.write(reinterpret_cast<const char*>(stream.data()), static_cast<std::streamsize>(stream.size()));
      file << std::string(gap, 'x');
      frames.streams.push_back({offset, static_cast<std::uint32_t>(stream.size())});
      offset += stream.size() + gap;
    }
    frames.count = count;
  }
};

TEST(FrameReader, ReadsInAnyOrderWhereverStreamsLie) {
  for (const std::size_t gap : {0, 7}) {
    const FrameFile file(8, gap);
    FrameReader reader(file.path, file.frames);
    for (const std::size_t k : {0, 1, 2, 3, 7, 6, 0, 5, 4}) {
      const auto pixels = reader.Read(k);
      ASSERT_THAT(pixels, IsOk());
      EXPECT_TRUE(std::ranges::equal(*pixels, Pixels(k))) << k;
    }
  }
}

TEST(FrameReader, ABlockThatWasReadIsThere) {
  const FrameFile file(8);
  FrameReader reader(file.path, file.frames);
  ASSERT_THAT(reader.Read(3), IsOk());
  std::filesystem::remove(file.path);
  EXPECT_THAT(reader.Read(5), IsOk());
  EXPECT_THAT(reader.Read(6), HasCode(Code::kNotFound));
  EXPECT_THAT(reader.Read(5), HasCode(Code::kNotFound)) << "what failed in between took its place";
}

TEST(FrameReader, RefusesWrongLocations) {
  const FrameFile file(8);
  const auto [offset, size] = file.frames.streams[4];  // the middle band of the second block
  const auto read = [&](StreamLocation location) -> Status {
    StoredFrames frames = file.frames;
    frames.streams[4] = location;
    EXPECT_THAT(FrameReader(file.path, frames).Read(2), IsOk());
    const auto pixels = FrameReader(file.path, frames).Read(3);
    return pixels ? Status() : Status(Fail(pixels.error()));
  };
  EXPECT_THAT(read({offset, size}), IsOk());
  EXPECT_THAT(read({offset + 1, size}), HasCode(Code::kCorrupt));
  EXPECT_THAT(read({offset, size - 1}), HasCode(Code::kCorrupt));
  EXPECT_THAT(read({1u << 30, size}), HasCode(Code::kCorrupt));
  EXPECT_THAT(read({0, UINT32_MAX}), HasCode(Code::kCorrupt));
  EXPECT_THAT(read({UINT64_MAX - 5, size}), HasCode(Code::kCorrupt));
}

TEST(FrameReader, ReadsFromManyThreadsAtOnce) {
  const FrameFile file(16);
  std::vector<Bytes> expected;
  for (std::size_t k = 0; k < 16; ++k) expected.push_back(Pixels(k));
  std::atomic<int> wrong{0};
  {
    std::vector<std::jthread> threads;
    for (std::uint64_t t = 0; t < 8; ++t)
      threads.emplace_back([&, t] {
        Rng rng(t);
        FrameReader reader(file.path, file.frames);
        for (int i = 0; i < 300; ++i) {
          const std::size_t k = rng.Below(16);
          const auto pixels = reader.Read(k);
          if (!pixels || !std::ranges::equal(*pixels, expected[k])) ++wrong;
        }
      });
  }
  EXPECT_EQ(wrong, 0);
}

}  // namespace frame_reader_test
}  // namespace etude::store
