// SPDX-License-Identifier: Apache-2.0
// A message is a polynomial over GF(2), its CRC the remainder modulo P. Far from the end only remainders
// matter, so a 128-bit block A may be replaced by one D bits further on that is congruent to A * x^D: two
// carry-less multiplications by constants. Many blocks side by side keep the multiplier busy; what is
// left of them goes through the CPU's CRC instruction.
// Source: Gopal et al., "Fast CRC Computation for Generic Polynomials Using PCLMULQDQ" (Intel, 2009).
#include "services/bus/checksum.h"

#include <array>
#include <cstddef>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace etude::bus {
namespace {

constexpr std::uint32_t kPolynomial = 0x82F63B78u;  // reflected: bit 31 is the coefficient of x^0

constexpr std::array<std::uint32_t, 256> MakeTable() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t value = i;
    for (int bit = 0; bit < 8; ++bit) value = (value >> 1) ^ ((value & 1) != 0 ? kPolynomial : 0u);
    table[i] = value;
  }
  return table;
}

// `crc` without the inversions at both ends.
std::uint32_t UpdatePortable(std::uint32_t crc, std::span<const std::uint8_t> bytes) {
  static constexpr auto kTable = MakeTable();
  for (const auto byte : bytes) crc = (crc >> 8) ^ kTable[(crc ^ byte) & 0xFFu];
  return crc;
}

#if defined(__x86_64__)

// x^n mod P, reflected, as a factor: one further bit, because the product of two reflected factors
// comes out one bit too low.
constexpr std::uint64_t Power(int n) {
  std::uint32_t value = 0x80000000u;  // x^0
  for (int i = 0; i < n; ++i) value = (value >> 1) ^ ((value & 1) != 0 ? kPolynomial : 0u);
  return std::uint64_t{value} << 1;
}

// Factors that move a block by `bits`: for its first and for its second 64 bits.
template <int bits>
struct Move {
  static constexpr auto kFirst = static_cast<long long>(Power(bits + 32));
  static constexpr auto kSecond = static_cast<long long>(Power(bits - 32));
};

__attribute__((target("sse4.2"))) std::uint32_t UpdateWords(std::uint32_t crc, std::span<const std::uint8_t> bytes) {
  std::uint64_t state = crc;
  const std::uint8_t* at = bytes.data();
  std::size_t left = bytes.size();
  for (; left >= 8; left -= 8, at += 8) {
    std::uint64_t word = 0;
    std::memcpy(&word, at, sizeof(word));
    state = _mm_crc32_u64(state, word);
  }
  auto end = static_cast<std::uint32_t>(state);
  for (; left > 0; --left, ++at) end = _mm_crc32_u8(end, *at);
  return end;
}

constexpr std::size_t kBlocks = 4;

// 64 bytes a round.
__attribute__((target("sse4.2,pclmul"))) std::uint32_t UpdateFolding(std::uint32_t crc,
                                                                     std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kRound = kBlocks * sizeof(__m128i);
  if (bytes.size() < 2 * kRound) return UpdateWords(crc, bytes);
  using Factors = Move<8 * kRound>;
  const __m128i factors = _mm_set_epi64x(Factors::kSecond, Factors::kFirst);
  const auto load = [&](std::size_t i, std::size_t block) __attribute__((target("sse4.2"))) {
    return _mm_loadu_si128(reinterpret_cast<const __m128i*>(bytes.data() + i) + block);
  };
  __m128i blocks[kBlocks];
  for (std::size_t k = 0; k < kBlocks; ++k) blocks[k] = load(0, k);
  blocks[0] = _mm_xor_si128(blocks[0], _mm_cvtsi32_si128(static_cast<int>(crc)));
  std::size_t i = kRound;
  for (; i + kRound <= bytes.size(); i += kRound) {
    for (std::size_t k = 0; k < kBlocks; ++k) {
      const __m128i first = _mm_clmulepi64_si128(blocks[k], factors, 0x00);
      const __m128i second = _mm_clmulepi64_si128(blocks[k], factors, 0x11);
      blocks[k] = _mm_xor_si128(_mm_xor_si128(first, second), load(i, k));
    }
  }
  std::array<std::uint8_t, kRound> rest;
  std::memcpy(rest.data(), blocks, kRound);
  return UpdateWords(UpdateWords(0, rest), bytes.subspan(i));
}

// 512 bytes a round, from a cache line's start: a load across two lines costs twice.
__attribute__((target("sse4.2,pclmul,avx512f,avx512vl,vpclmulqdq"))) std::uint32_t UpdateFoldingWide(
    std::uint32_t crc, std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kWide = 8, kRound = kWide * sizeof(__m512i);
  constexpr std::size_t kAhead = 4 * kRound;  // the hardware's own prefetch is late for frames in L2
  if (bytes.size() < 3 * kRound) return UpdateFolding(crc, bytes);
  const std::size_t head = -reinterpret_cast<std::uintptr_t>(bytes.data()) % sizeof(__m512i);
  crc = UpdateWords(crc, bytes.first(head));
  bytes = bytes.subspan(head);
  using Factors = Move<8 * kRound>;
  const __m512i factors = _mm512_set4_epi64(Factors::kSecond, Factors::kFirst, Factors::kSecond, Factors::kFirst);
  __m512i blocks[kWide];
  for (std::size_t k = 0; k < kWide; ++k) blocks[k] = _mm512_load_si512(bytes.data() + 64 * k);
  blocks[0] =
      _mm512_xor_si512(blocks[0], _mm512_set_epi32(0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, static_cast<int>(crc)));
  std::size_t i = kRound;
  for (; i + kRound <= bytes.size(); i += kRound) {
    for (std::size_t k = 0; k < kWide; ++k) {
      const std::uint8_t* const at = bytes.data() + i + 64 * k;
      _mm_prefetch(reinterpret_cast<const char*>(at + kAhead), _MM_HINT_T0);
      const __m512i first = _mm512_clmulepi64_epi128(blocks[k], factors, 0x00);
      const __m512i second = _mm512_clmulepi64_epi128(blocks[k], factors, 0x11);
      blocks[k] = _mm512_ternarylogic_epi64(first, second, _mm512_load_si512(at), 0x96);  // all three, by XOR
    }
  }
  std::array<std::uint8_t, kRound> rest;
  std::memcpy(rest.data(), blocks, kRound);
  return UpdateFolding(UpdateFolding(0, rest), bytes.subspan(i));
}

#endif

using Update = std::uint32_t (*)(std::uint32_t, std::span<const std::uint8_t>);

Update BestUpdate() {
#if defined(__x86_64__)
  const bool folds = __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("pclmul");
  const bool is_wide =
      __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("vpclmulqdq");
  if (folds && is_wide) return UpdateFoldingWide;
  if (folds) return UpdateFolding;
#endif
  return UpdatePortable;
}

}  // namespace

namespace internal {
std::uint32_t Crc32cPortable(std::span<const std::uint8_t> bytes) { return ~UpdatePortable(~0u, bytes); }
}  // namespace internal

std::uint32_t Crc32c(std::span<const std::uint8_t> bytes) {
  static const Update update = BestUpdate();
  return ~update(~0u, bytes);
}

}  // namespace etude::bus
