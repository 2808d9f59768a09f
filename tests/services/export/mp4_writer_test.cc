// SPDX-License-Identifier: Apache-2.0
// Tests services/export/mp4_writer.cc
#include "services/export/mp4_writer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/services/export/video_reader.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::exports {
namespace {

constexpr int kPictures = 103;

std::vector<std::uint8_t> Grey(int k) {
  return std::vector<std::uint8_t>(32 * 16 * 3, static_cast<std::uint8_t>(k * 2));
}

void WriteExample(const Path& path) {
  auto video = Mp4Writer::Create(path, {.width = 32, .height = 16, .fps = 25});
  ASSERT_THAT(video, IsOk());
  for (int k = 0; k < kPictures; ++k)
    ASSERT_THAT(video->Add(Grey(k), k == 51 ? KeyFrame::kForced : KeyFrame::kAsNeeded), IsOk());
  EXPECT_EQ(video->frames(), kPictures);
  ASSERT_THAT(video->Finish(), IsOk());
  EXPECT_GT(video->bytes(), 0u);
}

TEST(Mp4Writer, ShowsPictureKAtKOverTheRate) {
  const TemporaryFolder folder;
  WriteExample(folder / "a.mp4");

  const VideoContent video = ReadVideo(folder / "a.mp4");

  EXPECT_EQ(video.width, 32);
  EXPECT_EQ(video.height, 16);
  ASSERT_EQ(video.times.size(), static_cast<std::size_t>(kPictures));
  ASSERT_EQ(video.brightness.size(), static_cast<std::size_t>(kPictures));
  for (int k = 0; k < kPictures; ++k) {
    const auto i = static_cast<std::size_t>(k);
    EXPECT_NEAR(video.times[i], k / 25.0, 1e-12);
    EXPECT_NEAR(video.brightness[i], 16 + 2 * k * 219.0 / 255, 3);  // 16..235
  }
  for (const int k : {0, 2, 50, 51}) EXPECT_TRUE(video.keys[static_cast<std::size_t>(k)]) << k;
}

TEST(Mp4Writer, GivesTheSameBytesTwice) {
  const TemporaryFolder folder;
  WriteExample(folder / "a.mp4");
  WriteExample(folder / "b.mp4");

  EXPECT_EQ(*ReadBinaryFile(folder / "a.mp4"), *ReadBinaryFile(folder / "b.mp4"));
}

TEST(Mp4Writer, RefusesWhatItCannotWrite) {
  const TemporaryFolder folder;
  EXPECT_THAT(Mp4Writer::Create(folder / "a.mp4", {.width = 31, .height = 16, .fps = 25}), MessageHas("must be even"));
  EXPECT_THAT(Mp4Writer::Create(folder / "a.mp4", {.width = 32, .height = 16, .fps = 0}),
              HasCode(Code::kInvalidArgument));
  EXPECT_THAT(Mp4Writer::Create(folder / "none/a.mp4", {.width = 32, .height = 16, .fps = 25}),
              HasCode(Code::kUnavailable));
  auto video = Mp4Writer::Create(folder / "a.mp4", {.width = 32, .height = 16, .fps = 25});
  ASSERT_THAT(video, IsOk());
  EXPECT_THAT(video->Add(std::vector<std::uint8_t>(5), KeyFrame::kAsNeeded), MessageHas("5 bytes is not 32x16"));
}

}  // namespace
}  // namespace etude::exports
