// SPDX-License-Identifier: Apache-2.0
// Tests services/codec/checksum.cc
#include "services/codec/checksum.h"

#include <gtest/gtest.h>

#include <string>
#include <string_view>
#include <vector>

#include "services/core/rng.h"

namespace etude::codec {
namespace checksum_test {

std::span<const std::uint8_t> BytesOf(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

// By the polynomial's definition, a bit at a time.
std::uint32_t BitByBit(std::span<const std::uint8_t> bytes) {
  std::uint32_t crc = ~0u;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1) != 0 ? 0xedb88320u : 0u);
  }
  return ~crc;
}

std::vector<std::uint8_t> RandomBytes(Rng& rng, std::size_t size) {
  std::vector<std::uint8_t> bytes(size);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(rng.Below(256));
  return bytes;
}

// the check value of the CRC catalogues, and gzip's of a sentence
TEST(Crc32, IsGzips) {
  EXPECT_EQ(Crc32(0, {}), 0u);
  EXPECT_EQ(Crc32(0, BytesOf("123456789")), 0xcbf43926u);
  EXPECT_EQ(Crc32(0, BytesOf("The quick brown fox jumps over the lazy dog")), 0x414fa339u);
}

TEST(Crc32, AgreesWithThePolynomialAtEverySize) {
  Rng rng(1);
  for (std::size_t size = 0; size < 300; ++size) {
    const auto bytes = RandomBytes(rng, size);
    ASSERT_EQ(Crc32(0, bytes), BitByBit(bytes)) << size;
  }
  const auto large = RandomBytes(rng, 100'003);
  EXPECT_EQ(Crc32(0, large), BitByBit(large));
}

TEST(Crc32, OfPiecesIsThatOfTheWhole) {
  Rng rng(2);
  const auto bytes = RandomBytes(rng, 1000);
  const std::span<const std::uint8_t> all(bytes);
  const std::uint32_t whole = Crc32(0, all);
  for (int trial = 0; trial < 50; ++trial) {
    std::uint32_t crc = 0;
    for (std::size_t at = 0; at < all.size();) {
      const std::size_t size = std::min<std::size_t>(all.size() - at, rng.Below(200));
      crc = Crc32(crc, all.subspan(at, size));
      at += size;
    }
    ASSERT_EQ(crc, whole);
  }
}

TEST(Crc32, SeesEveryOneAndTwoBitsThatChange) {
  Rng rng(3);
  auto bytes = RandomBytes(rng, 64);
  const std::uint32_t good = Crc32(0, bytes);
  const auto flip = [&](std::size_t bit) { bytes[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8)); };
  for (std::size_t a = 0; a < 512; ++a) {
    flip(a);
    ASSERT_NE(Crc32(0, bytes), good) << a;
    for (std::size_t b = a + 1; b < 512; b += 7) {
      flip(b);
      ASSERT_NE(Crc32(0, bytes), good) << a << " " << b;
      flip(b);
    }
    flip(a);
  }
}

}  // namespace checksum_test
}  // namespace etude::codec
