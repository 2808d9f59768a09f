// SPDX-License-Identifier: Apache-2.0
// Tests services/language/wordnet.cc
#include "services/language/wordnet.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <map>

#include "services/core/rng.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::language {
namespace wordnet_test {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Not;

const WordNet& TheWordNet() {
  static const WordNet wordnet = WordNet::Open().value();
  return wordnet;
}

TEST(WordNet, GivesTheFirstSensesOfAWordAndNoMore) {
  EXPECT_THAT(TheWordNet().Synonyms("can", Part::kNoun), ElementsAre("tin", "tin can", "canful"));  // not "buttocks"
  EXPECT_THAT(TheWordNet().Synonyms("blue", Part::kAdjective), ElementsAre("bluish", "blueish"));
  EXPECT_THAT(TheWordNet().Synonyms("put down", Part::kVerb), ElementsAre("set down", "place down", "lay", "repose"));
  EXPECT_THAT(TheWordNet().Synonyms("raise", Part::kVerb), Contains("elevate"));
  EXPECT_THAT(TheWordNet().Synonyms("raise", Part::kVerb), Not(Contains("produce")));  // the fifth sense
}

TEST(WordNet, GivesOfANounWhatItIsAndItsKinds) {
  const auto bottle = TheWordNet().Related("bottle", Part::kNoun);
  EXPECT_THAT(bottle, Contains("bottleful")) << "what means the same";
  EXPECT_THAT(bottle, Contains("vessel")) << "what it is a kind of";
  EXPECT_THAT(bottle, Contains("carafe")) << "a kind of it";
  EXPECT_THAT(bottle, Not(Contains("container"))) << "two steps away";
  EXPECT_THAT(bottle, Not(Contains("bottle")));
  for (const auto& [word, part] : {std::pair{"move", Part::kVerb}, {"red", Part::kAdjective}})
    EXPECT_EQ(TheWordNet().Related(word, part), TheWordNet().Synonyms(word, part)) << word;
}

TEST(WordNet, LeavesNamesOut) {
  // its first sense is a judge, Warren Burger
  EXPECT_THAT(TheWordNet().Synonyms("burger", Part::kNoun), testing::UnorderedElementsAre("hamburger", "beefburger"));
}

TEST(WordNet, FindsEveryEntryOfAnIndex) {
  for (const char* word : {"a", "zymurgy", "apple", "zero", "square"}) EXPECT_TRUE(TheWordNet().Has(word, Part::kNoun));
  for (const char* word : {"abandon", "zoom", "pick up"}) EXPECT_TRUE(TheWordNet().Has(word, Part::kVerb)) << word;
  EXPECT_FALSE(TheWordNet().Has("cocacola", Part::kNoun));
  EXPECT_FALSE(TheWordNet().Has("", Part::kNoun));
  EXPECT_FALSE(TheWordNet().Has("zzzz", Part::kNoun));
}

// A small database in the format of wndb(5WN): entries with the lemmas of each of their senses.
class OwnWordNet : public testing::Test {
 protected:
  using Senses = std::vector<std::vector<std::string>>;

  OwnWordNet() {
    for (const char* part : {"noun", "verb", "adj"})
      for (const char* kind : {"index.", "data."}) Write(std::string(kind) + part, "  1 a licence\n");
  }
  void Write(const std::string& name, const std::string& text) {
    ASSERT_THAT(WriteFileAtomically(folder_ / name, text), IsOk());
  }
  // Both files of a part; the entries come sorted.
  void WritePart(const std::string& part, const std::map<std::string, Senses>& entries) {
    std::string data = "  1 a licence\n", index = data;
    for (const auto& [word, senses] : entries) {
      std::string offsets;
      for (const auto& lemmas : senses) {
        offsets += fmt::format(" {:08}", data.size());
        data += fmt::format("{:08} 03 n {:02x}", data.size(), lemmas.size());
        for (const auto& lemma : lemmas) data += " " + lemma + " 0";
        data += " 001 @ 00000000 n 0000 | what it means\n";
      }
      index += fmt::format("{} n {} 2 @ ~ {} 1{}\n", word, senses.size(), senses.size(), offsets);
    }
    Write("data." + part, data);
    Write("index." + part, index);
  }
  std::vector<std::string> Synonyms(const std::string& words, Part part) {
    return WordNet::Open(folder_.path()).value().Synonyms(words, part);
  }

  TemporaryFolder folder_;
};

TEST_F(OwnWordNet, GivesALemmaForEachOfTheFirstSenses) {
  WritePart("noun", {{"tin", {{"tin", "can", "Tin_Can", "tin_box"}, {"element"}, {"money"}}}});
  WritePart("verb", {{"raise", {{"lift", "raise"}, {"elevate", "get_up", "lift"}, {"grow"}}}});
  WritePart("adj", {{"blue", {{"blue(a)", "azure", "azure"}}}});
  EXPECT_THAT(Synonyms("tin", Part::kNoun), ElementsAre("can", "tin box", "element")) << "a name is none";
  EXPECT_THAT(Synonyms("raise", Part::kVerb), ElementsAre("lift", "elevate", "get up")) << "two senses of a verb";
  EXPECT_THAT(Synonyms("blue", Part::kAdjective), ElementsAre("azure")) << "where it may stand is no part of it";
  EXPECT_THAT(Synonyms("tin", Part::kVerb), IsEmpty());
}

TEST_F(OwnWordNet, FindsEveryEntryWhereverItStands) {
  Rng rng(1);
  for (int round = 0; round < 20; ++round) {
    std::map<std::string, Senses> entries;
    const auto count = rng.Below(30);
    while (entries.size() < count) {
      std::string word;
      for (auto n = 1 + rng.Below(9); n > 0; --n) word += static_cast<char>('a' + rng.Below(3));
      entries[word] = {{word, "of_" + word}};
    }
    WritePart("noun", entries);
    const auto wordnet = WordNet::Open(folder_.path());
    ASSERT_THAT(wordnet, IsOk());
    for (const auto& [word, senses] : entries) {
      ASSERT_TRUE(wordnet->Has(word, Part::kNoun)) << word << " of " << entries.size();
      EXPECT_THAT(wordnet->Synonyms(word, Part::kNoun), ElementsAre("of " + word));
      if (!entries.contains(word + "a")) {
        EXPECT_FALSE(wordnet->Has(word + "a", Part::kNoun)) << word;
      }
    }
  }
}

TEST_F(OwnWordNet, ADataFileOfAnotherVersionGivesNothing) {
  WritePart("noun", {{"tin", {{"tin", "can"}}}});
  Write("data.noun", ReadTextFile(folder_ / "data.noun").value().substr(2));  // each line begins two letters earlier
  EXPECT_THAT(Synonyms("tin", Part::kNoun), IsEmpty());
  Write("data.noun", "");
  EXPECT_THAT(Synonyms("tin", Part::kNoun), IsEmpty());
}

TEST_F(OwnWordNet, NamesTheFileThatIsNotThere) {
  for (const char* name : {"index.verb", "data.adj"}) {
    const std::string text = ReadTextFile(folder_ / name).value();
    std::filesystem::remove(folder_ / name);
    EXPECT_THAT(WordNet::Open(folder_.path()), MessageHas(name));
    Write(name, text);
  }
  EXPECT_THAT(WordNet::Open(folder_.path()), IsOk());
}

TEST(WordNet, NamesWhatIsMissing) {
  const auto wordnet = WordNet::Open("/nowhere");
  ASSERT_FALSE(wordnet);
  EXPECT_EQ(wordnet.error().code, Code::kNotFound);
  EXPECT_THAT(wordnet.error().message, ::testing::HasSubstr("install wordnet-base"));
}

}  // namespace wordnet_test
}  // namespace etude::language
