// SPDX-License-Identifier: Apache-2.0
// Random numbers that are the same on every machine: xoshiro256++ seeded by SplitMix64, with our own
// distributions, because those of <random> differ between standard libraries.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

namespace etude {

/// A pure hash of numbers and text into a seed: MixSeed({spec.seed, index, attempt}, "scene").
std::uint64_t MixSeed(std::initializer_list<std::uint64_t> numbers, std::string_view purpose = {});

/// Source: Blackman & Vigna, "Scrambled linear pseudorandom number generators" (2021), xoshiro256++.
/// Not thread-safe: one per owner. Copying copies the stream.
class Rng {
 public:
  explicit Rng(std::uint64_t seed);

  std::uint64_t Next();
  /// Uniform in [0, 1) with 53 bits.
  double Uniform();
  /// Uniform in [low, high).
  double Uniform(double low, double high) { return low + (high - low) * Uniform(); }
  /// Uniform in {0, ..., n-1} without bias; n >= 1.
  std::uint64_t Below(std::uint64_t n);
  /// Normal(0, 1), Box-Muller.
  double Normal();
  bool Bernoulli(double probability) { return Uniform() < probability; }

  /// Fisher-Yates.
  template <class T>
  void Shuffle(std::vector<T>& items) {
    for (std::size_t i = items.size(); i > 1; --i) std::swap(items[i - 1], items[Below(i)]);
  }

  /// The whole state, so that a resumed run continues the same stream.
  const std::array<std::uint64_t, 4>& state() const { return state_; }
  void set_state(const std::array<std::uint64_t, 4>& state) { state_ = state; }

 private:
  std::array<std::uint64_t, 4> state_;
};

}  // namespace etude
