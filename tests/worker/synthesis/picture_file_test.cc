// SPDX-License-Identifier: Apache-2.0
// Tests worker/synthesis/picture_file.cc and decoded_picture.h
#include "worker/synthesis/picture_file.h"

#include <gmock/gmock.h>

#include <opencv2/imgcodecs.hpp>

#include "tests/support/matchers.h"

namespace etude::synthesis {
namespace picture_file_test {

TEST(DecodePicture, ReadsWhatWasEncoded) {
  const Texture texture = PaletteTexture({{1, 0, 0}, {0, 0, 1}});
  const auto bytes = EncodePng(texture);
  ASSERT_THAT(bytes, IsOk());
  const auto read = DecodePicture(*bytes, "test");
  ASSERT_THAT(read, IsOk());
  EXPECT_EQ(read->width, texture.width);
  EXPECT_EQ(read->rgb, texture.rgb);
}

// a photograph that was taken upright: its stored pixels are what texture coordinates mean
TEST(DecodePicture, IsNotTurnedAsACameraWasHeld) {
  std::vector<std::uint8_t> bytes;
  ASSERT_TRUE(cv::imencode(".jpg", cv::Mat(16, 32, CV_8UC3, cv::Scalar(9, 9, 9)), bytes));
  const std::vector<std::uint8_t> turned{0xff, 0xe1, 0x00, 0x22, 'E',  'x',  'i',  'f',  0x00, 0x00, 'M',  'M',
                                         0x00, 0x2a, 0x00, 0x00, 0x00, 0x08, 0x00, 0x01, 0x01, 0x12, 0x00, 0x03,
                                         0x00, 0x00, 0x00, 0x01, 0x00, 0x06, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00};
  bytes.insert(bytes.begin() + 2, turned.begin(), turned.end());
  const auto read = DecodePicture(bytes, "photo.jpg");
  ASSERT_THAT(read, IsOk());
  EXPECT_EQ(read->width, 32);
  EXPECT_EQ(read->height, 16);
}

TEST(DecodePicture, WhatIsNoPictureIsAnError) {
  EXPECT_THAT(DecodePicture({}, "test"), HasCode(Code::kCorrupt));
  EXPECT_THAT(DecodePicture({1, 2, 3}, "test"), HasCode(Code::kCorrupt));
}

// More pixels than OpenCV takes, about which it throws.
TEST(DecodePicture, ATooLargePictureIsAnError) {
  const std::vector<std::uint8_t> header{0x89, 'P',  'N',  'G',  0x0d, 0x0a, 0x1a, 0x0a,        // signature
                                         0x00, 0x00, 0x00, 0x0d, 'I',  'H',  'D',  'R',         // of 13 bytes:
                                         0x00, 0x00, 0x9c, 0x40, 0x00, 0x00, 0x9c, 0x40,        // 40000 x 40000
                                         0x08, 0x02, 0x00, 0x00, 0x00, 0xde, 0x6e, 0x99, 0x52,  // RGB, and the checksum
                                         0x00, 0x00, 0x00, 0x10, 'I',  'D',  'A',  'T',  0x00,
                                         0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00};
  EXPECT_THAT(DecodePicture(header, "large.png"), HasCode(Code::kCorrupt));
  EXPECT_THAT(DecodePicture(header, "large.png"), MessageHas("large.png"));
}

}  // namespace picture_file_test
}  // namespace etude::synthesis
