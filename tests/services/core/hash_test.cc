// SPDX-License-Identifier: Apache-2.0
// Tests services/core/hash.cc against the vectors of FIPS 180-4.
#include "services/core/hash.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "services/core/rng.h"

namespace etude {
namespace hash_test {

TEST(Sha256, MatchesPublishedVectors) {
  EXPECT_EQ(Sha256Hex(std::string_view("")), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(Sha256Hex(std::string_view("abc")), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Sha256, MatchesThePublishedVectorsOfSeveralBlocks) {
  const std::string_view two = "abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq";
  const std::string_view four =
      "abcdefghbcdefghicdefghijdefghijkefghijklfghijklmghijklmnhijklmnoijklmnopjklmnopqklmnopqrlmnopqrsmnopqrstnopqrst"
      "u";
  EXPECT_EQ(Sha256Hex(two), "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(Sha256Hex(four), "cf5b16a778af8380036ce59e7b0492370b249b11e8f07a51afac45037afee9d1");
  EXPECT_EQ(Sha256Hex(std::string(1'000'000, 'a')), "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST(Sha256, WhereTheBytesAreCutDoesNotMatter) {
  Rng rng(3);
  std::vector<std::uint8_t> bytes(5000);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(rng.Below(256));
  for (int round = 0; round < 50; ++round) {
    Sha256 begun;
    std::size_t at = 0;
    while (at < bytes.size() / 2) {
      const std::size_t size = std::min<std::size_t>(rng.Below(200), bytes.size() - at);
      begun.Update(std::span(bytes).subspan(at, size));
      at += size;
    }
    Sha256 moved = std::move(begun);
    moved.Update(std::span(bytes).subspan(at));
    ASSERT_EQ(moved.Finish(), Sha256Of(bytes));
  }
  bytes[4999] ^= 1;
  EXPECT_NE(ToHex(Sha256Of(bytes)), Sha256Hex(std::span(bytes).first(4999)));
}

TEST(Sha256, ASeedIsItsFirst52Bits) {
  EXPECT_EQ(SeedOf(Sha256Of({})), 0xe3b0c44298fc1u);  // of e3b0c442 98fc1c14 ...
}

TEST(Sha256, PiecesGiveTheSameDigest) {
  Sha256 hash;
  hash.Update(std::string_view("a"));
  hash.Update(std::string_view(""));
  hash.Update(std::string_view("bc"));
  EXPECT_EQ(ToHex(hash.Finish()), Sha256Hex(std::string_view("abc")));
}

}  // namespace hash_test
}  // namespace etude
