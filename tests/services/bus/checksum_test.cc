// SPDX-License-Identifier: Apache-2.0
#include "services/bus/checksum.h"

#include <gtest/gtest.h>

#include <cstring>
#include <span>
#include <string_view>
#include <vector>

namespace etude::bus {
namespace {

std::vector<std::uint8_t> Ramp(std::size_t size) {
  std::vector<std::uint8_t> bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::uint8_t>(i * 37 + i / 251);
  return bytes;
}

// values of RFC 3720, B.4, and the usual check value
TEST(Crc, HasThePublishedValues) {
  constexpr std::string_view kText = "123456789";
  EXPECT_EQ(Crc32c({reinterpret_cast<const std::uint8_t*>(kText.data()), kText.size()}), 0xE3069283u);
  EXPECT_EQ(Crc32c(std::vector<std::uint8_t>(32, 0)), 0x8A9136AAu);
  EXPECT_EQ(Crc32c(std::vector<std::uint8_t>(32, 0xFF)), 0x62A8AB43u);
}

TEST(Crc, PortableAndFastAgree) {
  const auto bytes = Ramp(150528);
  for (std::size_t size = 0; size < 2300; ++size) {
    const auto part = std::span(bytes).subspan(size % 67, size);
    EXPECT_EQ(Crc32c(part), internal::Crc32cPortable(part)) << size;
  }
  EXPECT_EQ(Crc32c(bytes), internal::Crc32cPortable(bytes));
}

TEST(Crc, FindsEverySingleWrongBit) {
  auto bytes = Ramp(900);
  const auto before = Crc32c(bytes);
  for (std::size_t bit = 0; bit < bytes.size() * 8; ++bit) {
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
    EXPECT_NE(Crc32c(bytes), before) << bit;
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
  }
}

TEST(Crc, FindsSwappedWords) {
  auto bytes = Ramp(256);
  const auto before = Crc32c(bytes);
  std::swap_ranges(bytes.begin(), bytes.begin() + 8, bytes.begin() + 8);
  EXPECT_NE(Crc32c(bytes), before);
}

}  // namespace
}  // namespace etude::bus
