// SPDX-License-Identifier: Apache-2.0
#include "services/core/hash.h"

#include <openssl/evp.h>

#include "services/core/check.h"

namespace etude {

struct Sha256::Context {
  EVP_MD_CTX* evp = EVP_MD_CTX_new();
  ~Context() { EVP_MD_CTX_free(evp); }
};

Sha256::Sha256() : context_(std::make_unique<Context>()) {
  ETUDE_CHECK(EVP_DigestInit_ex(context_->evp, EVP_sha256(), nullptr) == 1);
}
Sha256::~Sha256() = default;
Sha256::Sha256(Sha256&&) noexcept = default;
Sha256& Sha256::operator=(Sha256&&) noexcept = default;

void Sha256::Update(std::span<const std::uint8_t> bytes) {
  ETUDE_CHECK(EVP_DigestUpdate(context_->evp, bytes.data(), bytes.size()) == 1);
}

void Sha256::Update(std::string_view text) {
  Update({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

Sha256Digest Sha256::Finish() {
  Sha256Digest digest;
  unsigned int size = 0;
  ETUDE_CHECK(EVP_DigestFinal_ex(context_->evp, digest.data(), &size) == 1 && size == 32);
  return digest;
}

Sha256Digest Sha256Of(std::span<const std::uint8_t> bytes) {
  Sha256 hash;
  hash.Update(bytes);
  return hash.Finish();
}

std::string ToHex(const Sha256Digest& digest) {
  std::string text;
  text.reserve(64);
  for (std::uint8_t byte : digest) fmt::format_to(std::back_inserter(text), "{:02x}", byte);
  return text;
}

std::uint64_t SeedOf(const Sha256Digest& digest) {
  std::uint64_t seed = 0;
  for (int i = 0; i < 7; ++i) seed = seed << 8 | digest[static_cast<std::size_t>(i)];
  return seed >> 4;  // 52 of 56
}

std::string Sha256Hex(std::span<const std::uint8_t> bytes) { return ToHex(Sha256Of(bytes)); }

std::string Sha256Hex(std::string_view text) {
  return Sha256Hex({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

}  // namespace etude
