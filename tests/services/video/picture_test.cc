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

// a mean over areas: what is smaller keeps its brightness, and no edge
TEST(Resized, SmallerIsTheMeanOfWhatItCovers) {
  Picture picture{8, 4, {}};
  for (int i = 0; i < 8 * 4 * 3; ++i) picture.rgb.push_back(static_cast<std::uint8_t>((37 * i) % 251));
  const Picture small = Resized(picture, 4);
  ASSERT_EQ(small.width, 4);
  ASSERT_EQ(small.height, 2);
  for (int y = 0; y < 2; ++y)
    for (int x = 0; x < 4; ++x)
      for (int c = 0; c < 3; ++c) {
        double sum = 0;
        for (const int dy : {0, 1})
          for (const int dx : {0, 1})
            sum += picture.rgb[static_cast<std::size_t>(((2 * y + dy) * 8 + 2 * x + dx) * 3 + c)];
        EXPECT_NEAR(small.rgb[static_cast<std::size_t>((y * 4 + x) * 3 + c)], sum / 4, 0.51);
      }
}

TEST(Resized, LargerHasNoColoursOfItsOwnAndTheSameSizeIsTheSame) {
  const Picture picture = Example();
  const Picture large = Resized(picture, 12);
  ASSERT_EQ(large.width, 12);
  ASSERT_EQ(large.height, 6);
  EXPECT_EQ(large.rgb, Enlarged(picture, 3).rgb);
  EXPECT_EQ(Resized(picture, 4).rgb, picture.rgb);
  // sides stay in proportion, and a row is the least
  EXPECT_EQ(Resized(Picture{100, 1, std::vector<std::uint8_t>(300)}, 10).height, 1);
  EXPECT_EQ(Resized(picture, 1).height, 1);
}

TEST(Joined, IsEachRowOfEachBesideTheNext) {
  std::vector<Picture> pictures;
  for (const int width : {1, 3, 2}) {
    Picture picture{width, 2, {}};
    for (int i = 0; i < width * 2 * 3; ++i) picture.rgb.push_back(static_cast<std::uint8_t>(40 * width + i));
    pictures.push_back(picture);
  }
  const Picture joined = Joined(pictures);
  ASSERT_EQ(joined.width, 6);
  ASSERT_EQ(joined.rgb.size(), 6u * 2 * 3);
  for (int row = 0; row < 2; ++row) {
    int column = 0;
    for (const auto& picture : pictures)
      for (int x = 0; x < picture.width; ++x, ++column)
        for (int c = 0; c < 3; ++c)
          EXPECT_EQ(joined.rgb[static_cast<std::size_t>((row * 6 + column) * 3 + c)],
                    picture.rgb[static_cast<std::size_t>((row * picture.width + x) * 3 + c)]);
  }
  EXPECT_DEATH((void)Joined({}), "");
  const std::vector<Picture> uneven{pictures[0], Picture{1, 1, {1, 2, 3}}};
  EXPECT_DEATH((void)Joined(uneven), "px beside");
}

TEST(EncodeWebp, WorseIsSmaller) {
  Picture picture{64, 64, {}};
  for (int i = 0; i < 64 * 64 * 3; ++i) picture.rgb.push_back(static_cast<std::uint8_t>((i * i) % 253));
  const auto good = EncodeWebp(picture, 95), bad = EncodeWebp(picture, 10);
  ASSERT_THAT(good, IsOk());
  ASSERT_THAT(bad, IsOk());
  EXPECT_LT(bad->size(), good->size());
  EXPECT_EQ(*EncodeWebp(picture, 95), *good) << "the same bytes again";
}

}  // namespace picture_test
}  // namespace etude::video
