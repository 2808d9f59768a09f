// SPDX-License-Identifier: Apache-2.0
// Tests services/video/mp4_writer.cc
#include "services/video/mp4_writer.h"

#include <gtest/gtest.h>

#include <opencv2/videoio.hpp>
#include <vector>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::video {
namespace {

constexpr int kSide = 64, kPictures = 12;

// all of one grey
std::vector<std::uint8_t> Grey(int value) {
  return std::vector<std::uint8_t>(kSide * kSide * 3, static_cast<std::uint8_t>(value));
}

void WriteSteps(const Path& file) {
  auto writer = Mp4Writer::Open(file, {.width = kSide, .height = kSide, .rate = {125, 5}});
  ASSERT_THAT(writer, IsOk());
  for (int k = 0; k < kPictures; ++k) ASSERT_THAT(writer->Write(Grey(20 * k)), IsOk());
  ASSERT_THAT(writer->Finish(), IsOk());
}

TEST(Mp4Writer, KeepsEveryPictureInOrderAtItsRate) {
  TemporaryFolder folder;
  WriteSteps(folder / "a.mp4");

  cv::VideoCapture video((folder / "a.mp4").string());
  ASSERT_TRUE(video.isOpened());
  EXPECT_NEAR(video.get(cv::CAP_PROP_FPS), 25, 1e-6);
  cv::Mat picture;
  int n = 0;
  for (; video.read(picture); ++n) EXPECT_NEAR(cv::mean(picture)[0], 20 * n, 6) << n;
  EXPECT_EQ(n, kPictures);
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

}  // namespace
}  // namespace etude::video
