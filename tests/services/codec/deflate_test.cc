// SPDX-License-Identifier: Apache-2.0
// Tests services/codec/deflate.cc
#include "services/codec/deflate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/rng.h"
#include "tests/support/matchers.h"

namespace etude::codec {
namespace deflate_test {

using Bytes = std::vector<std::uint8_t>;

// smooth colours with a little noise
Bytes Pixels(int seed, std::size_t size) {
  Rng rng(static_cast<std::uint64_t>(seed));
  Bytes pixels(size);
  for (std::size_t i = 0; i < size; ++i) pixels[i] = static_cast<std::uint8_t>(i / 50 + rng.Below(4));
  return pixels;
}

TEST(Deflate, InflatesToWhatWasDeflatedAndIsDeterministic) {
  for (const std::size_t size : {std::size_t{1}, std::size_t{300}, std::size_t{224 * 224 * 3}}) {
    const Bytes pixels = Pixels(1, size);
    const Bytes stream = Deflate(pixels);
    Bytes back(size);

    ASSERT_THAT(Inflate(stream, back), IsOk());
    EXPECT_EQ(back, pixels);
    EXPECT_EQ(stream, Deflate(pixels));
  }
}

TEST(Deflate, NoStreamIsLargerThanItsBound) {
  for (const std::size_t size : {0, 1, 100, 5000, 150'000}) {
    Rng rng(size);
    Bytes noise(size);
    for (auto& byte : noise) byte = static_cast<std::uint8_t>(rng.Next());
    EXPECT_LE(Deflate(noise).size(), StreamBound(size)) << size;
  }
}

TEST(Inflate, RefusesEveryOtherSizeAndEveryFlippedBit) {
  const Bytes pixels = Pixels(2, 600);
  const Bytes stream = Deflate(pixels);
  for (const std::size_t size : {0, 599, 601}) {
    Bytes back(size);
    EXPECT_THAT(Inflate(stream, back), HasCode(Code::kCorrupt)) << size;
  }
  Bytes longer = stream;
  longer.push_back(0);
  Bytes back(600);
  EXPECT_THAT(Inflate(longer, back), HasCode(Code::kCorrupt));
  for (std::size_t size = 0; size < stream.size(); ++size)
    ASSERT_THAT(Inflate(std::span(stream).first(size), back), HasCode(Code::kCorrupt)) << size;
  for (std::size_t bit = 0; bit < 8 * stream.size(); ++bit) {
    Bytes flipped = stream;
    flipped[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
    // the format leaves bits without meaning; what inflates must then be the same picture
    if (Inflate(flipped, back)) {
      ASSERT_EQ(back, pixels) << bit;
    }
  }
}

}  // namespace deflate_test
}  // namespace etude::codec
