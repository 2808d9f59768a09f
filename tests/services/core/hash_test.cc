// SPDX-License-Identifier: Apache-2.0
// Tests services/core/hash.cc against the vectors of FIPS 180-4.
#include "services/core/hash.h"

#include <gtest/gtest.h>

namespace etude {
namespace {

TEST(Sha256, MatchesPublishedVectors) {
  EXPECT_EQ(Sha256Hex(std::string_view("")), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(Sha256Hex(std::string_view("abc")), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Sha256, PiecesGiveTheSameDigest) {
  Sha256 hash;
  hash.Update(std::string_view("a"));
  hash.Update(std::string_view(""));
  hash.Update(std::string_view("bc"));
  EXPECT_EQ(ToHex(hash.Finish()), Sha256Hex(std::string_view("abc")));
}

}  // namespace
}  // namespace etude
