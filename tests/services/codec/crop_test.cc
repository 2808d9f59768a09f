// SPDX-License-Identifier: Apache-2.0
// Tests services/codec/crop.cc
#include "services/codec/crop.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "tests/support/matchers.h"

namespace etude::codec {
namespace crop_test {

std::vector<std::uint8_t> Counting(int width, int height) {
  std::vector<std::uint8_t> picture(static_cast<std::size_t>(width) * height * 3);
  for (std::size_t i = 0; i < picture.size(); ++i) picture[i] = static_cast<std::uint8_t>(i);
  return picture;
}

TEST(CropPicture, TakesTheRegionRowByRow) {
  const auto picture = Counting(5, 4);
  const Region region{1, 2, 3, 2};
  std::vector<std::uint8_t> out(region.bytes());
  ASSERT_THAT(CropPicture(picture, 5, 4, region, out), IsOk());
  for (int y = 0; y < 2; ++y)
    for (int i = 0; i < 9; ++i) EXPECT_EQ(out[9 * y + i], picture[15 * (y + 2) + 3 + i]);
  std::vector<std::uint8_t> all(picture.size());
  ASSERT_THAT(CropPicture(picture, 5, 4, {0, 0, 5, 4}, all), IsOk());
  EXPECT_EQ(all, picture);
}

TEST(CropPicture, RefusesWhatLiesOutsideWithoutReadingIt) {
  const auto picture = Counting(5, 4);
  constexpr int kMax = std::numeric_limits<int>::max(), kMin = std::numeric_limits<int>::min();
  for (const Region& region :
       {Region{-1, 0, 2, 2}, Region{0, -1, 2, 2}, Region{4, 0, 2, 2}, Region{0, 3, 2, 2}, Region{0, 0, 6, 1},
        Region{0, 0, 1, 5}, Region{0, 0, 0, 1}, Region{0, 0, 1, -1}, Region{kMax, 0, 1, 1}, Region{0, kMax, 1, 1},
        Region{kMin, 0, 1, 1}, Region{1, 1, kMax, 1}, Region{1, 1, 1, kMax}}) {
    EXPECT_FALSE(Fits(region, 5, 4)) << region.u;
    std::vector<std::uint8_t> out(12);
    EXPECT_THAT(CropPicture(picture, 5, 4, region, out), HasCode(Code::kInvalidArgument));
  }
  std::vector<std::uint8_t> short_out(11);
  EXPECT_THAT(CropPicture(picture, 5, 4, {0, 0, 2, 2}, short_out), HasCode(Code::kInvalidArgument));
  std::vector<std::uint8_t> out(12);
  EXPECT_THAT(CropPicture(std::span(picture).first(59), 5, 4, {0, 0, 2, 2}, out), HasCode(Code::kInvalidArgument));
}

}  // namespace crop_test
}  // namespace etude::codec
