// SPDX-License-Identifier: Apache-2.0
// Tests services/video/mp4_writer.cc
#include "services/video/mp4_writer.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/services/video/video_reader.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::video {
namespace mp4_writer_test {

constexpr int kSide = 64, kPictures = 103, kForced = 52;

// all of one grey
std::vector<std::uint8_t> Grey(int value) {
  return std::vector<std::uint8_t>(kSide * kSide * 3, static_cast<std::uint8_t>(value));
}

void WriteSteps(const Path& file) {
  auto writer = Mp4Writer::Open(file, {.width = kSide, .height = kSide, .rate = {125, 5}});
  ASSERT_THAT(writer, IsOk());
  for (int k = 0; k < kPictures; ++k)
    ASSERT_THAT(writer->Write(Grey(2 * k), k == kForced ? KeyFrame::kForced : KeyFrame::kAsNeeded), IsOk());
  EXPECT_EQ(writer->pictures(), kPictures);
  ASSERT_THAT(writer->Finish(), IsOk());
  EXPECT_GT(writer->bytes(), 0u);
}

TEST(Mp4Writer, ShowsPictureKAtKOverTheRate) {
  const TemporaryFolder folder;
  WriteSteps(folder / "a.mp4");

  const VideoContent video = ReadVideo(folder / "a.mp4");

  EXPECT_EQ(video.width, kSide);
  EXPECT_EQ(video.height, kSide);
  ASSERT_EQ(video.times.size(), static_cast<std::size_t>(kPictures));
  ASSERT_EQ(video.brightness.size(), static_cast<std::size_t>(kPictures));
  for (int k = 0; k < kPictures; ++k) {
    const auto i = static_cast<std::size_t>(k);
    EXPECT_NEAR(video.times[i], k / 25.0, 1e-12);
    EXPECT_NEAR(video.brightness[i], 16 + 2 * k * 219.0 / 255, 3);  // 16..235
  }
  EXPECT_TRUE(video.keys[0]);
  EXPECT_TRUE(video.keys[kForced]);
  int since_key = 0;
  for (const bool key : video.keys) {
    since_key = key ? 0 : since_key + 1;
    EXPECT_LT(since_key, 5);
  }
}

TEST(Mp4Writer, GivesTheSameBytesTwice) {
  const TemporaryFolder folder;
  WriteSteps(folder / "a.mp4");
  WriteSteps(folder / "b.mp4");

  EXPECT_EQ(*ReadBinaryFile(folder / "a.mp4"), *ReadBinaryFile(folder / "b.mp4"));
}

TEST(Mp4Writer, PutsTheIndexInFront) {
  TemporaryFolder folder;
  WriteSteps(folder / "a.mp4");

  const std::string bytes = ReadTextFile(folder / "a.mp4").value();
  ASSERT_NE(bytes.find("moov"), std::string::npos);
  EXPECT_LT(bytes.find("moov"), bytes.find("mdat")) << "a browser plays it while it arrives";
}

TEST(Mp4Writer, RefusesWhatNoEncoderTakes) {
  TemporaryFolder folder;
  EXPECT_THAT(Mp4Writer::Open(folder / "a.mp4", {.width = 63, .height = 64}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(Mp4Writer::Open(folder / "a.mp4", {}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(Mp4Writer::Open(folder / "no" / "a.mp4", {.width = 64, .height = 64}), HasCode(Code::kUnavailable));
  auto writer = Mp4Writer::Open(folder / "b.mp4", {.width = kSide, .height = kSide});
  ASSERT_THAT(writer, IsOk());
  EXPECT_THAT(writer->Write(std::vector<std::uint8_t>(10)), HasCode(Code::kInvalidArgument));
}

}  // namespace mp4_writer_test
}  // namespace etude::video
