// SPDX-License-Identifier: Apache-2.0
// Tests services/video/mp4_writer.cc
#include "services/video/mp4_writer.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <iterator>
#include <string>
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

TEST(Mp4Writer, AnyRateAndAnySizeThatIsEven) {
  const TemporaryFolder folder;
  for (const FrameRate rate : {FrameRate{125, 1}, FrameRate{125, 5}, FrameRate{1, 2}, FrameRate{30'000, 1001}}) {
    const Path file = folder / (std::to_string(rate.numerator) + "-" + std::to_string(rate.denominator) + ".mp4");
    auto writer = Mp4Writer::Open(file, {.width = 34, .height = 18, .rate = rate});
    ASSERT_THAT(writer, IsOk());
    for (int k = 0; k < 4; ++k) ASSERT_THAT(writer->Write(std::vector<std::uint8_t>(34 * 18 * 3, 80)), IsOk());
    ASSERT_THAT(writer->Finish(), IsOk());
    const VideoContent video = ReadVideo(file);
    EXPECT_EQ(video.width, 34);
    EXPECT_EQ(video.height, 18);
    ASSERT_EQ(video.times.size(), 4u);
    // the container counts time in ticks of its own, none coarser than a tenth of a picture
    for (std::size_t k = 0; k < 4; ++k)
      EXPECT_NEAR(video.times[k] * rate.numerator / rate.denominator, static_cast<double>(k), 0.05) << rate.numerator;
  }
}

TEST(Mp4Writer, OnePictureIsAVideo) {
  const TemporaryFolder folder;
  auto one = Mp4Writer::Open(folder / "one.mp4", {.width = kSide, .height = kSide});
  ASSERT_THAT(one, IsOk());
  ASSERT_THAT(one->Write(Grey(100)), IsOk());
  ASSERT_THAT(one->Finish(), IsOk());
  EXPECT_EQ(ReadVideo(folder / "one.mp4").times.size(), 1u);
  EXPECT_EQ(one->pictures(), 1);
}

// a picture that is refused is not counted, and the video goes on without it
TEST(Mp4Writer, APictureOfAnotherSizeChangesNothing) {
  const TemporaryFolder folder;
  auto writer = Mp4Writer::Open(folder / "a.mp4", {.width = kSide, .height = kSide});
  ASSERT_THAT(writer, IsOk());
  ASSERT_THAT(writer->Write(Grey(50)), IsOk());
  EXPECT_THAT(writer->Write(std::vector<std::uint8_t>(kSide * kSide)), HasCode(Code::kInvalidArgument));
  EXPECT_EQ(writer->pictures(), 1);
  ASSERT_THAT(writer->Write(Grey(60)), IsOk());
  ASSERT_THAT(writer->Finish(), IsOk());
  EXPECT_EQ(ReadVideo(folder / "a.mp4").times.size(), 2u);
}

TEST(Mp4Writer, AMovingPictureForPagesHasItsFramesAndRepeats) {
  const TemporaryFolder folder;
  auto writer = Mp4Writer::Open(
      folder / "a.webp", {.width = kSide, .height = kSide, .rate = {5, 1}, .container = Container::kAnimatedWebp});
  if (!writer && writer.error().code == Code::kUnavailable) GTEST_SKIP() << writer.error().message;
  ASSERT_THAT(writer, IsOk());
  for (int k = 0; k < 3; ++k) ASSERT_THAT(writer->Write(Grey(80 * k)), IsOk());
  ASSERT_THAT(writer->Finish(), IsOk());
  const std::string bytes = ReadTextFile(folder / "a.webp").value_or("");
  EXPECT_EQ(bytes.substr(0, 4), "RIFF");
  EXPECT_EQ(bytes.substr(8, 4), "WEBP");
  std::size_t frames = 0;
  for (std::size_t at = bytes.find("ANMF"); at != std::string::npos; at = bytes.find("ANMF", at + 4)) ++frames;
  EXPECT_EQ(frames, 3u);
  const auto header = bytes.find("ANIM");
  ASSERT_NE(header, std::string::npos);
  EXPECT_EQ(bytes.substr(header + 12, 2), std::string("\0\0", 2)) << "how often it is shown: 0, for ever";
}

// libav took what stands before the colon for a protocol, and an evaluation in a folder of that name had no videos
TEST(Mp4Writer, APathMayHaveAColon) {
  const TemporaryFolder folder;
  const Path before = std::filesystem::current_path();
  std::filesystem::current_path(folder.path());
  WriteSteps("eval-12:30.mp4");
  std::filesystem::current_path(before);
  EXPECT_EQ(ReadVideo(folder / "eval-12:30.mp4").times.size(), static_cast<std::size_t>(kPictures));
}

// a file of this name was gone with the first picture of a new one, whether that came to its end or not
TEST(Mp4Writer, WhatWasThereStaysUntilTheNewOneIsWhole) {
  const TemporaryFolder folder;
  const Path file = folder / "a.mp4";
  WriteSteps(file);
  const auto whole = *ReadBinaryFile(file);
  {
    auto writer = Mp4Writer::Open(file, {.width = kSide, .height = kSide});
    ASSERT_THAT(writer, IsOk());
    ASSERT_THAT(writer->Write(Grey(50)), IsOk());
    EXPECT_EQ(*ReadBinaryFile(file), whole);
  }
  EXPECT_EQ(*ReadBinaryFile(file), whole);
  const auto entries = std::filesystem::directory_iterator(folder.path());
  EXPECT_EQ(std::distance(begin(entries), end(entries)), 1) << "nothing is left beside it";
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
