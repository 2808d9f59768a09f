// SPDX-License-Identifier: Apache-2.0
// Tests trainer/data/cutout.cc
#include "trainer/data/cutout.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <set>
#include <vector>

namespace etude::data {
namespace cutout_test {

constexpr int kWidth = 40, kHeight = 24;

// every pixel differs from its neighbours, and none is grey
std::vector<std::uint8_t> Picture() {
  std::vector<std::uint8_t> rgb;
  for (int i = 0; i < kWidth * kHeight; ++i)
    for (const int value : {i % 251, (i + 1) % 251, (i + 2) % 251}) rgb.push_back(static_cast<std::uint8_t>(value));
  return rgb;
}

// which pixels differ from Picture()
std::vector<bool> Changed(const std::vector<std::uint8_t>& rgb) {
  const auto whole = Picture();
  std::vector<bool> changed;
  for (std::size_t i = 0; i < rgb.size(); i += 3)
    changed.push_back(rgb[i] != whole[i] || rgb[i + 1] != whole[i + 1] || rgb[i + 2] != whole[i + 2]);
  return changed;
}

TEST(CutOut, HidesHalfOfTheMostOnAverageAndNeverTheSame) {
  std::set<int> greys, phases;
  double hidden = 0;
  constexpr int kPictures = 400;
  for (std::uint64_t seed = 0; seed < kPictures; ++seed) {
    Rng rng(seed);
    auto rgb = Picture();
    CutOut(0.4, kWidth, kHeight, rng, rgb);
    const auto changed = Changed(rgb);
    std::set<int> of_this;
    for (std::size_t i = 0; i < changed.size(); ++i) {
      if (!changed[i]) continue;
      ++hidden;
      of_this.insert(rgb[3 * i]);
      EXPECT_TRUE(rgb[3 * i] == rgb[3 * i + 1] && rgb[3 * i] == rgb[3 * i + 2]) << "a grey";
      const int x = static_cast<int>(i) % kWidth;
      if (x > 0 && !changed[i - 1]) phases.insert(x % kCutoutBlock);
    }
    EXPECT_LE(of_this.size(), 1u) << "one grey a picture";
    greys.insert(of_this.begin(), of_this.end());
  }
  EXPECT_NEAR(hidden / (kPictures * kWidth * kHeight), 0.2, 0.02);
  EXPECT_GT(greys.size(), 150u);
  EXPECT_EQ(phases.size(), static_cast<std::size_t>(kCutoutBlock)) << "the grid lies anywhere";
}

TEST(CutOut, CoversWholeSquaresThatEndAtTheEdge) {
  Rng rng(11);
  auto rgb = Picture();
  CutOut(0.5, kWidth, kHeight, rng, rgb);
  const auto changed = Changed(rgb);
  // the columns where anything begins or ends lie eight apart
  std::set<int> columns, rows;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const auto i = static_cast<std::size_t>(y * kWidth + x);
      if (x > 0 && changed[i] != changed[i - 1]) columns.insert(x % kCutoutBlock);
      if (y > 0 && changed[i] != changed[i - kWidth]) rows.insert(y % kCutoutBlock);
    }
  EXPECT_EQ(columns.size(), 1u);
  EXPECT_EQ(rows.size(), 1u);
}

TEST(CutOut, OfNothingLeavesThePicture) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    Rng rng(seed);
    auto rgb = Picture();
    CutOut(0, kWidth, kHeight, rng, rgb);
    EXPECT_EQ(rgb, Picture());
  }
}

}  // namespace cutout_test
}  // namespace etude::data
