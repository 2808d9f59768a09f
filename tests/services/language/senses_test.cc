// SPDX-License-Identifier: Apache-2.0
// Tests services/language/senses.cc, and the senses of services/language/wordnet.cc and tokenizer.cc
#include "services/language/senses.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <set>
#include <thread>

#include "services/language/tokenizer.h"
#include "tests/support/matchers.h"

namespace etude::language {
namespace senses_test {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::IsEmpty;
using ::testing::Not;

const Senses& TheSenses() {
  static const auto senses = Senses::Open().value();
  return *senses;
}

std::vector<std::string> Of(const std::string& word, const std::string& previous = "") {
  return *TheSenses().Of(previous, word);
}

TEST(Senses, AreWhatAWordMayMeanAndWhatThatIsAKindOf) {
  const std::string bread = "noun:bread/breadstuff/staff_of_life";
  EXPECT_THAT(Of("bread"), Contains(bread));
  EXPECT_THAT(Of("naan"), Contains(bread)) << "a step up";
  EXPECT_THAT(Of("flask"), AllOf(Contains("noun:bottle"), Contains("noun:container"))) << "one and three steps up";
  EXPECT_THAT(Of("flask"), Not(Contains("noun:instrumentality/instrumentation"))) << "four steps up";
  EXPECT_THAT(Of("red"), Not(Contains(bread)));
  EXPECT_THAT(Of("lift"), Contains("verb:raise/lift/elevate/get_up/bring_up"));
}

TEST(Senses, OfAnAdjectiveAreThoseOfTheNounThatItComesFrom) {
  EXPECT_THAT(Of("rectangular"), Contains("noun:rectangle"));
  EXPECT_THAT(Of("cuboidal"), Contains("noun:cube/regular_hexahedron"));
}

TEST(Senses, KnowEndingsAndEntriesOfTwoWords) {
  EXPECT_EQ(Of("loafs"), Of("loaf"));
  EXPECT_THAT(Of("lifting"), Contains("verb:raise/lift/elevate/get_up/bring_up"));
  EXPECT_THAT(Of("drink", "soft"), Contains("noun:soft_drink"));
  EXPECT_THAT(Of("drink", "hot"), Not(Contains("noun:soft_drink")));
}

TEST(Senses, OfNoEntryAreNone) {
  for (const char* word : {"", "xqvzk", "perrier"}) EXPECT_THAT(Of(word), IsEmpty()) << word;
}

TEST(Senses, RefuseAnotherWordNetThanTheOneAskedFor) {
  EXPECT_THAT(Senses::Open(TheSenses().sha256()), IsOk());
  EXPECT_THAT(Senses::Open(std::string(64, 'a')), MessageHas("trained with aaaaaaaaaaaa"));
  EXPECT_THAT(Senses::Open("", "/nowhere"), MessageHas("install wordnet-base"));
}

TEST(Senses, AreTheSameWhoeverAsksWhen) {
  const WordNet wordnet = WordNet::Open().value();
  const auto senses = Senses::Open().value();
  EXPECT_EQ(senses.get(), &TheSenses()) << "open already";
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i)
    threads.emplace_back([&] {
      for (const char* word : {"bottle", "can", "naan", "bottle"})
        EXPECT_EQ(*senses->Of("the", word), wordnet.Senses(word));
    });
  for (auto& thread : threads) thread.join();
}

TEST(Tokenize, PutsSensesBehindSpellingsInARangeOfTheirOwn) {
  TokenizerConfig config;
  config.buckets = 512;
  const std::string sentence = "push the rye bread xqvzk";
  const auto plain = Tokenize(sentence, config), words = Tokenize(sentence, config, &TheSenses());
  ASSERT_EQ(words.size(), plain.size());
  for (std::size_t w = 0; w < words.size(); ++w) {
    EXPECT_TRUE(std::equal(plain[w].begin(), plain[w].end(), words[w].begin())) << w;
    for (std::size_t f = plain[w].size(); f < words[w].size(); ++f) {
      EXPECT_GE(words[w][f], config.buckets);
      EXPECT_LT(words[w][f], config.buckets + kSenseBuckets);
    }
  }
  EXPECT_EQ(words.back(), plain.back()) << "a word that means nothing";
  EXPECT_GT(words[3].size(), plain[3].size());
}

// The share of what both may mean.
double Common(const std::string& a, const std::string& b) {
  const auto x = Of(a), y = Of(b);
  const std::set<std::string> first(x.begin(), x.end());
  const auto both = std::ranges::count_if(y, [&](const auto& name) { return first.contains(name); });
  return static_cast<double>(both) / static_cast<double>(std::min(x.size(), y.size()));
}

TEST(Senses, AreCloserOfWordsThatMeanSomethingAlike) {
  for (const char* bread : {"naan", "loaf", "toast"})
    for (const char* other : {"bottle", "can", "cube"})
      EXPECT_GT(Common(bread, "bread"), Common(bread, other)) << bread;
  for (const char* bottle : {"flask", "decanter", "cruet"})
    for (const char* other : {"milk", "bread", "cube"}) EXPECT_GT(Common(bottle, "bottle"), Common(bottle, other));
}

}  // namespace senses_test
}  // namespace etude::language
