// SPDX-License-Identifier: Apache-2.0
// Tests services/video/picture.cc
#include "services/video/picture.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "tests/support/matchers.h"

namespace etude::video {
namespace picture_test {

// 4 x 2 px, each of its own colour
Picture Example() {
  Picture picture{4, 2, {}};
  for (int i = 0; i < 4 * 2 * 3; ++i) picture.rgb.push_back(static_cast<std::uint8_t>(10 * i));
  return picture;
}

TEST(EncodePng, KeepsEveryPixel) {
  const Picture picture = Example();
  const auto png = EncodePng(picture);
  ASSERT_THAT(png, IsOk());

  const cv::Mat bgr = cv::imdecode(*png, cv::IMREAD_COLOR);
  ASSERT_EQ(bgr.size(), cv::Size(4, 2));
  for (int i = 0; i < 8; ++i)
    for (int channel = 0; channel < 3; ++channel)
      EXPECT_EQ(bgr.at<cv::Vec3b>(i / 4, i % 4)[2 - channel], picture.rgb[static_cast<std::size_t>(3 * i + channel)]);
}

TEST(EncodeWebp, HasThePicturesSize) {
  const auto webp = EncodeWebp(Enlarged(Example(), 8));
  ASSERT_THAT(webp, IsOk());
  EXPECT_EQ(cv::imdecode(*webp, cv::IMREAD_COLOR).size(), cv::Size(32, 16));
}

TEST(EncodePng, RefusesBytesThatAreNoSuchPicture) {
  EXPECT_THAT(EncodePng({4, 2, {1, 2, 3}}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(EncodePng({}), HasCode(Code::kInvalidArgument));
}

TEST(Picture, IsEnlargedAndJoinedPixelByPixel) {
  const Picture picture = Example();
  const Picture large = Enlarged(picture, 2);
  ASSERT_EQ(large.width, 8);
  ASSERT_EQ(large.height, 4);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 8; ++x)
      EXPECT_EQ(large.rgb[static_cast<std::size_t>((y * 8 + x) * 3)],
                picture.rgb[static_cast<std::size_t>((y / 2 * 4 + x / 2) * 3)]);
  const std::vector<Picture> two{picture, picture};
  const Picture joined = Joined(two);
  ASSERT_EQ(joined.width, 8);
  EXPECT_EQ(joined.rgb[12], picture.rgb[0]) << "the second begins where the first row of the first ends";
  EXPECT_EQ(Resized(picture, 2).height, 1);
}

}  // namespace picture_test
}  // namespace etude::video
