// SPDX-License-Identifier: Apache-2.0
// Tests services/language/wordnet.cc
#include "services/language/wordnet.h"

#include <gmock/gmock.h>

namespace etude::language {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Not;

const WordNet& TheWordNet() {
  static const WordNet wordnet = WordNet::Open().value();
  return wordnet;
}

TEST(WordNet, GivesTheFirstSensesOfAWordAndNoMore) {
  EXPECT_THAT(TheWordNet().Synonyms("can", Part::kNoun), ElementsAre("tin", "tin can"));  // not "canful", "buttocks"
  EXPECT_THAT(TheWordNet().Synonyms("blue", Part::kAdjective), ElementsAre("bluish", "blueish"));
  EXPECT_THAT(TheWordNet().Synonyms("put down", Part::kVerb), ElementsAre("set down", "place down", "lay", "repose"));
  EXPECT_THAT(TheWordNet().Synonyms("raise", Part::kVerb), Contains("elevate"));
  EXPECT_THAT(TheWordNet().Synonyms("raise", Part::kVerb), Not(Contains("produce")));  // the fifth sense
}

TEST(WordNet, LeavesNamesOut) {
  EXPECT_THAT(TheWordNet().Synonyms("burger", Part::kNoun), IsEmpty());  // a judge's, to WordNet
}

TEST(WordNet, FindsEveryEntryOfAnIndex) {
  for (const char* word : {"a", "zymurgy", "apple", "zero", "square"}) EXPECT_TRUE(TheWordNet().Has(word, Part::kNoun));
  for (const char* word : {"abandon", "zoom", "pick up"}) EXPECT_TRUE(TheWordNet().Has(word, Part::kVerb)) << word;
  EXPECT_FALSE(TheWordNet().Has("cocacola", Part::kNoun));
  EXPECT_FALSE(TheWordNet().Has("", Part::kNoun));
  EXPECT_FALSE(TheWordNet().Has("zzzz", Part::kNoun));
}

TEST(WordNet, NamesWhatIsMissing) {
  const auto wordnet = WordNet::Open("/nowhere");
  ASSERT_FALSE(wordnet);
  EXPECT_EQ(wordnet.error().code, Code::kNotFound);
  EXPECT_THAT(wordnet.error().message, ::testing::HasSubstr("install wordnet-base"));
}

}  // namespace
}  // namespace etude::language
