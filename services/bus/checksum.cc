// SPDX-License-Identifier: Apache-2.0
#include "services/bus/checksum.h"

#include <cstring>

#if defined(__x86_64__)
#include <nmmintrin.h>
#endif

namespace etude::bus {
namespace {

constexpr std::size_t kStreams = 4;
constexpr std::size_t kStripe = kStreams * sizeof(std::uint64_t);

std::uint64_t LoadWord(const std::uint8_t* bytes) {
  std::uint64_t word = 0;
  std::memcpy(&word, bytes, sizeof(word));
  return word;
}

StripedCrc Finish(const std::array<std::uint32_t, kStreams>& streams) {
  StripedCrc out{};
  for (std::size_t i = 0; i < kStreams; ++i) {
    const std::uint32_t value = ~streams[i];
    for (std::size_t byte = 0; byte < 4; ++byte) {
      out[4 * i + byte] = static_cast<std::uint8_t>(value >> (8 * byte));
    }
  }
  return out;
}

constexpr std::array<std::uint32_t, 256> MakeTable() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t value = i;
    for (int bit = 0; bit < 8; ++bit) value = (value >> 1) ^ ((value & 1) != 0 ? 0x82F63B78u : 0u);
    table[i] = value;
  }
  return table;
}

#if defined(__x86_64__)
__attribute__((target("sse4.2"))) StripedCrc WithInstruction(std::span<const std::uint8_t> bytes) {
  std::uint64_t s0 = 0xFFFFFFFFu, s1 = s0, s2 = s0, s3 = s0;
  const std::uint8_t* at = bytes.data();
  std::size_t left = bytes.size();
  for (; left >= kStripe; left -= kStripe, at += kStripe) {
    s0 = _mm_crc32_u64(s0, LoadWord(at));
    s1 = _mm_crc32_u64(s1, LoadWord(at + 8));
    s2 = _mm_crc32_u64(s2, LoadWord(at + 16));
    s3 = _mm_crc32_u64(s3, LoadWord(at + 24));
  }
  auto tail = static_cast<std::uint32_t>(s0);
  for (; left > 0; --left, ++at) tail = _mm_crc32_u8(tail, *at);
  return Finish({tail, static_cast<std::uint32_t>(s1), static_cast<std::uint32_t>(s2),
                 static_cast<std::uint32_t>(s3)});
}
#endif

}  // namespace

namespace internal {

StripedCrc StripedCrc32cPortable(std::span<const std::uint8_t> bytes) {
  static constexpr auto kTable = MakeTable();
  std::array<std::uint32_t, kStreams> streams;
  streams.fill(0xFFFFFFFFu);
  const std::size_t striped = bytes.size() / kStripe * kStripe;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    auto& value = streams[i < striped ? i / 8 % kStreams : 0];
    value = (value >> 8) ^ kTable[(value ^ bytes[i]) & 0xFFu];
  }
  return Finish(streams);
}

}  // namespace internal

StripedCrc StripedCrc32c(std::span<const std::uint8_t> bytes) {
#if defined(__x86_64__)
  static const bool has_instruction = __builtin_cpu_supports("sse4.2") != 0;
  if (has_instruction) return WithInstruction(bytes);
#endif
  return internal::StripedCrc32cPortable(bytes);
}

}  // namespace etude::bus
