// SPDX-License-Identifier: Apache-2.0
// SHA-256 (FIPS 180-4, OpenSSL's implementation).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace etude {

using Sha256Digest = std::array<std::uint8_t, 32>;

/// Digest of bytes that arrive in pieces. Not thread-safe.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;

  void Update(std::span<const std::uint8_t> bytes);
  void Update(std::string_view text);
  /// Ends the digest; the object must not be updated afterwards.
  Sha256Digest Finish();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

Sha256Digest Sha256Of(std::span<const std::uint8_t> bytes);
std::string Sha256Hex(std::span<const std::uint8_t> bytes);
std::string Sha256Hex(std::string_view text);
/// 64 lower-case hexadecimal digits.
std::string ToHex(const Sha256Digest& digest);
/// Its first 52 bits, as a seed: a whole number that every reader of JSON keeps.
std::uint64_t SeedOf(const Sha256Digest& digest);

}  // namespace etude
