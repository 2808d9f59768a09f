// SPDX-License-Identifier: Apache-2.0
#include "services/core/rng.h"

#include <bit>
#include <cmath>
#include <numbers>

#include "services/core/check.h"

namespace etude {
namespace {

// SplitMix64's output function: a bijection with good avalanche.
std::uint64_t Avalanche(std::uint64_t z) {
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

}  // namespace

std::uint64_t MixSeed(std::initializer_list<std::uint64_t> numbers, std::string_view purpose) {
  std::uint64_t hash = 0x9e3779b97f4a7c15ULL;
  for (std::uint64_t number : numbers) hash = Avalanche(hash + 0x9e3779b97f4a7c15ULL + number);
  for (unsigned char c : purpose) hash = Avalanche(hash + 0x9e3779b97f4a7c15ULL + c);
  return hash;
}

Rng::Rng(std::uint64_t seed) {
  for (auto& word : state_) {
    seed += 0x9e3779b97f4a7c15ULL;
    word = Avalanche(seed);
  }
}

std::uint64_t Rng::Next() {
  const std::uint64_t result = std::rotl(state_[0] + state_[3], 23) + state_[0];
  const std::uint64_t t = state_[1] << 17;
  state_[2] ^= state_[0];
  state_[3] ^= state_[1];
  state_[1] ^= state_[2];
  state_[0] ^= state_[3];
  state_[2] ^= t;
  state_[3] = std::rotl(state_[3], 45);
  return result;
}

double Rng::Uniform() { return static_cast<double>(Next() >> 11) * 0x1.0p-53; }

std::uint64_t Rng::Below(std::uint64_t n) {
  ETUDE_CHECK(n >= 1, "n={}", n);
  // rejection keeps it unbiased: drop the last, incomplete block of n
  const std::uint64_t limit = UINT64_MAX - (UINT64_MAX % n + 1) % n;
  std::uint64_t draw = Next();
  while (draw > limit) draw = Next();
  return draw % n;
}

double Rng::Normal() {
  const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform()));
  return radius * std::cos(2.0 * std::numbers::pi * Uniform());
}

}  // namespace etude
