// SPDX-License-Identifier: Apache-2.0
#include "services/bus/checksum.h"

#include <gtest/gtest.h>

#include <cstring>
#include <numeric>
#include <string_view>
#include <vector>

namespace etude::bus {
namespace {

std::vector<std::uint8_t> Ramp(std::size_t size) {
  std::vector<std::uint8_t> bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::uint8_t>(i * 37 + i / 251);
  return bytes;
}

TEST(StripedCrc, IsCrc32cForShortBlocks) {
  constexpr std::string_view kText = "123456789";  // the check value of CRC-32C is 0xE3069283
  const auto crc = StripedCrc32c({reinterpret_cast<const std::uint8_t*>(kText.data()), kText.size()});
  const std::array<std::uint8_t, 4> expected{0x83, 0x92, 0x06, 0xE3};
  EXPECT_TRUE(std::equal(expected.begin(), expected.end(), crc.begin()));
}

TEST(StripedCrc, PortableAndFastAgree) {
  for (const std::size_t size : {0u, 1u, 7u, 8u, 31u, 32u, 33u, 63u, 64u, 100u, 1000u, 150528u}) {
    const auto bytes = Ramp(size);
    EXPECT_EQ(StripedCrc32c(bytes), internal::StripedCrc32cPortable(bytes)) << size;
  }
}

TEST(StripedCrc, FindsEverySingleWrongBit) {
  auto bytes = Ramp(200);
  const auto before = StripedCrc32c(bytes);
  for (std::size_t bit = 0; bit < bytes.size() * 8; ++bit) {
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
    EXPECT_NE(StripedCrc32c(bytes), before) << bit;
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
  }
}

TEST(StripedCrc, FindsSwappedWords) {
  auto bytes = Ramp(256);
  const auto before = StripedCrc32c(bytes);
  std::swap_ranges(bytes.begin(), bytes.begin() + 8, bytes.begin() + 8);
  EXPECT_NE(StripedCrc32c(bytes), before);
}

}  // namespace
}  // namespace etude::bus
