// SPDX-License-Identifier: Apache-2.0
// Tests services/language/tokenizer.cc
#include "services/language/tokenizer.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <set>

#include "services/core/rng.h"

namespace etude::language {
namespace tokenizer_test {

TEST(Normalize, LowersAndDropsPunctuation) {
  EXPECT_EQ(Normalize("  Pick UP the Coke-can! "), "pick up the coke can");
  EXPECT_EQ(Normalize("..."), "");
  EXPECT_EQ(Normalize(""), "");
}

std::string RandomText(Rng& rng) {
  std::string text;
  for (auto n = rng.Below(40); n > 0; --n)
    text += rng.Bernoulli(0.2) ? ' ' : static_cast<char>(rng.Bernoulli(0.7) ? 32 + rng.Below(95) : rng.Below(256));
  return text;
}

TEST(Normalize, OfAnythingIsLowerCaseWordsWithSingleSpaces) {
  Rng rng(1);
  for (int round = 0; round < 2000; ++round) {
    const std::string text = RandomText(rng), normal = Normalize(text);
    EXPECT_EQ(Normalize(normal), normal) << "it is normal already";
    EXPECT_EQ(normal.find("  "), std::string::npos);
    EXPECT_FALSE(normal.starts_with(' ') || normal.ends_with(' '));
    for (const unsigned char c : normal)
      EXPECT_TRUE(c == ' ' || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c >= 0x80) << static_cast<int>(c);
    const TokenizerConfig config;
    EXPECT_EQ(Tokenize(text, config), Tokenize(normal, config));
  }
}

// FNV-1a as its authors publish it (isthe.com/chongo/tech/comp/fnv), 64 bit.
std::uint64_t Fnv(const std::string& text) {
  std::uint64_t hash = 14695981039346656037u;
  for (const unsigned char c : text) hash = (hash ^ c) * 1099511628211u;
  return hash;
}

// A checkpoint's embeddings are found by these numbers, so they may never change.
TEST(Tokenize, IdsAreFnvOfWordNgramAndPair) {
  ASSERT_EQ(Fnv(""), 0xcbf29ce484222325u);
  ASSERT_EQ(Fnv("foobar"), 0x85944171f73967e8u);
  const TokenizerConfig config{.buckets = 1000, .min_ngram = 3, .max_ngram = 4};
  const auto id = [&](const std::string& text) {
    const std::uint64_t hash = Fnv(text);
    return static_cast<std::int64_t>((hash ^ (hash >> 32)) % 1000);
  };
  const auto words = Tokenize("Red can", config);
  ASSERT_EQ(words.size(), 2u);
  EXPECT_THAT(words[0], testing::ElementsAre(id("wred"), id("n<re"), id("nred"), id("ned>"), id("n<red"), id("nred>"),
                                             id("p red")));
  EXPECT_THAT(words[1], testing::ElementsAre(id("wcan"), id("n<ca"), id("ncan"), id("nan>"), id("n<can"), id("ncan>"),
                                             id("pred can")));
}

TEST(Tokenize, HasAsManyFeaturesAsTheWordHasPieces) {
  Rng rng(2);
  for (int round = 0; round < 200; ++round) {
    const TokenizerConfig config{.buckets = 1 + static_cast<int>(rng.Below(50)),
                                 .min_ngram = 1 + static_cast<int>(rng.Below(3)),
                                 .max_ngram = 3 + static_cast<int>(rng.Below(3))};
    const std::string word(1 + rng.Below(9), 'x');
    std::size_t pieces = 2;  // the word and its pair
    for (int n = config.min_ngram; n <= config.max_ngram; ++n)
      pieces += std::max(0, static_cast<int>(word.size()) + 2 - n + 1);
    const auto words = Tokenize("push " + word, config);
    ASSERT_EQ(words.size(), 2u);
    EXPECT_EQ(words[1].size(), pieces);
    for (const auto id : words[1]) EXPECT_TRUE(id >= 0 && id < config.buckets);
  }
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

}  // namespace tokenizer_test
}  // namespace etude::language
