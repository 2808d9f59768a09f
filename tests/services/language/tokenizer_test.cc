// SPDX-License-Identifier: Apache-2.0
// Tests services/language/tokenizer.cc
#include "services/language/tokenizer.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <set>

namespace etude::language {
namespace {

TEST(Normalize, LowersAndDropsPunctuation) {
  EXPECT_EQ(Normalize("  Pick UP the Coke-can! "), "pick up the coke can");
  EXPECT_EQ(Normalize("..."), "");
  EXPECT_EQ(Normalize(""), "");
}

TEST(Tokenize, GivesWordNgramsAndPair) {
  const TokenizerConfig config;
  const auto words = Tokenize("red can", config);
  ASSERT_EQ(words.size(), 2u);
  // "<can>": the word, 3 trigrams, 2 four-grams, 1 five-gram, the pair "red can"
  EXPECT_EQ(words[1].size(), 1u + 3 + 2 + 1 + 1);
  for (const auto& word : words)
    for (const auto id : word) {
      EXPECT_GE(id, 0);
      EXPECT_LT(id, config.buckets);
    }
}

TEST(Tokenize, ATypoSharesFeaturesWithTheWord) {
  const TokenizerConfig config;
  const auto right = Tokenize("bottle", config)[0];
  const auto wrong = Tokenize("botle", config)[0];
  const auto other = Tokenize("push", config)[0];
  const auto shared = [&](const WordFeatures& a, const WordFeatures& b) {
    const std::set<std::int64_t> set(a.begin(), a.end());
    return std::count_if(b.begin(), b.end(), [&](auto id) { return set.contains(id); });
  };
  EXPECT_GE(shared(right, wrong), 5);
  EXPECT_LE(shared(right, other), 1);
}

TEST(Tokenize, OrderMattersThroughPairs) {
  const TokenizerConfig config;
  EXPECT_NE(Tokenize("can red", config)[1], Tokenize("red can", config)[0]);
}

TEST(Tokenize, IsBounded) {
  const TokenizerConfig config;
  std::string longer;
  for (int i = 0; i < 1000; ++i) longer += "word ";
  EXPECT_EQ(Tokenize(longer, config).size(), static_cast<std::size_t>(config.max_words));
  EXPECT_EQ(Tokenize("", config).size(), 1u);
  EXPECT_EQ(Tokenize(std::string("\xff\x00\x80 x", 5), config).size(), 3u);  // NUL separates
}

}  // namespace
}  // namespace etude::language
