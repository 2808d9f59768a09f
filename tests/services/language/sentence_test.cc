// SPDX-License-Identifier: Apache-2.0
// Tests services/language/sentence.cc: what is drawn into sentences (grammar_test: which sentences are drawn)
#include "services/language/sentence.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <map>
#include <set>

#include "services/language/grammar.h"
#include "services/language/vocabulary.h"

namespace etude::language {
namespace sentence_test {

using ::testing::Contains;
using ::testing::IsEmpty;
using ::testing::IsSupersetOf;
using ::testing::Not;

using Words = std::vector<std::string>;

const Words kSix{"cube", "coke", "pepsi", "milk", "bread", "bottle"};

// What is left of two texts without what they begin and end with alike.
std::pair<std::string, std::string> Differing(std::string a, std::string b) {
  while (!a.empty() && !b.empty() && a.front() == b.front()) a.erase(0, 1), b.erase(0, 1);
  while (!a.empty() && !b.empty() && a.back() == b.back()) a.pop_back(), b.pop_back();
  return {a, b};
}

TEST(AddStrangeWord, LeavesTheOthersInTheirOrder) {
  std::set<std::size_t> places;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    Rng rng(seed);
    std::string text = "pick up can";
    AddStrangeWord(text, rng);
    Words found = SplitWords(text);
    ASSERT_EQ(found.size(), 4u) << text;
    const auto strange = std::ranges::find_if(
        found, [](const std::string& word) { return word != "pick" && word != "up" && word != "can"; });
    places.insert(static_cast<std::size_t>(strange - found.begin()));
    EXPECT_GE(strange->size(), 3u);
    found.erase(strange);
    EXPECT_EQ(found, (Words{"pick", "up", "can"})) << text;
  }
  EXPECT_EQ(places.size(), 4u) << "anywhere, behind the last, too";
}

TEST(AddTypo, ChangesOneLetterInsideOfAWord) {
  Rng rng(37);
  std::map<std::string, int> kinds;
  const std::string text = "pick up the green bottle and keep away";
  for (int i = 0; i < 4000; ++i) {
    std::string typed = text;
    AddTypo(typed, rng);
    EXPECT_EQ(std::count(typed.begin(), typed.end(), ' '), std::count(text.begin(), text.end(), ' ')) << typed;
    const auto [before, after] = Differing(text, typed);
    const bool swapped = before.size() == 2 && after == std::string{before[1], before[0]};
    const char* kind = before.empty() && after.empty()           ? "none"
                       : before.size() == 1 && after.empty()     ? "dropped"
                       : before.empty() && after.size() == 1     ? "doubled"
                       : before.size() == 1 && after.size() == 1 ? "replaced"
                       : swapped                                 ? "swapped"
                                                                 : "?";
    EXPECT_STRNE(kind, "?") << typed;
    ++kinds[kind];
  }
  for (const char* kind : {"none", "dropped", "doubled", "replaced", "swapped"}) EXPECT_GT(kinds[kind], 300) << kind;
  for (std::string shortest : {"", "a", "ab", "a b"}) {
    const std::string kept = shortest;
    for (int i = 0; i < 50; ++i) AddTypo(shortest, rng);
    EXPECT_EQ(shortest, kept) << "nothing inside of a word";
  }
}

// What varied sentences about `object` call it beside words of random letters, which every such phrase has one of.
std::set<std::string> LeftOfMasked(const Vocabulary& vocabulary, const std::string& object) {
  const Command command{"push", object};
  const std::set<std::string> known = AllWords(vocabulary, command);
  std::set<std::string> left;
  Rng rng(43);
  for (int i = 0; i < 2000; ++i) {
    const Words words = SplitWords(DrawVaried(vocabulary, command, 1, rng));
    const auto strange = [&](const std::string& word) { return !known.contains(word); };
    if (std::ranges::none_of(words, strange)) continue;
    EXPECT_EQ(std::ranges::count_if(words, strange), 1) << testing::PrintToString(words);
    for (const auto& phrase : AllPhrases(*vocabulary.FindNoun(object)))
      for (const auto& word : SplitWords(phrase))
        if (std::ranges::count(words, word) > 0) left.insert(word);
  }
  return left;
}

TEST(DrawVaried, MasksWordsThatTheOthersMakeUpFor) {
  const Vocabulary vocabulary = Vocabulary::LoadFor(kSix, {}).value();
  const auto cube = LeftOfMasked(vocabulary, "cube");
  EXPECT_THAT(cube, IsSupersetOf({"cube", "square", "maroon", "block"}));
  EXPECT_THAT(cube, Not(Contains("red"))) << "a red can is red, too";
  const auto milk = LeftOfMasked(vocabulary, "milk");
  EXPECT_THAT(milk, IsSupersetOf({"milk", "white", "carton", "box"})) << "either of two that tell it";
  const auto pepsi = LeftOfMasked(vocabulary, "pepsi");
  EXPECT_THAT(pepsi, Contains("blue"));
  EXPECT_THAT(vocabulary.FindNoun("pepsi")->nouns.at("can"), Contains("tin"));
  EXPECT_THAT(pepsi, Not(Contains("tin"))) << "there are two cans";
}

TEST(DrawVaried, WhatTellsAnObjectDependsOnTheOthersOfATraining) {
  const Vocabulary alone = Vocabulary::LoadFor({"cube", "milk"}, {}).value();
  EXPECT_THAT(LeftOfMasked(alone, "cube"), Contains("red")) << "nothing else is";
  const Vocabulary twins = Vocabulary::LoadFor({"lemon_00", "lemon_01"}, {}).value();
  EXPECT_THAT(twins.FindNoun("lemon_01")->telling, Contains("lemon")) << "of one class, with one noun";
}

TEST(DrawVaried, MasksNothingUnlessAsked) {
  const Vocabulary vocabulary = Vocabulary::LoadFor(kSix, {}).value();
  for (const auto& object : kSix) {
    const std::set<std::string> known = AllWords(vocabulary, {"push", object});
    Rng rng(47);
    for (int i = 0; i < 500; ++i)
      for (const auto& word : SplitWords(DrawVaried(vocabulary, {"push", object}, 0, rng)))
        EXPECT_THAT(known, Contains(word));
  }
}

TEST(Vocabulary, MostObjectsHaveWordsThatTellThem) {
  const Vocabulary vocabulary = Vocabulary::LoadFor(kSix, {}).value();
  for (const auto& object : kSix) EXPECT_THAT(vocabulary.FindNoun(object)->telling, Not(IsEmpty())) << object;
}

}  // namespace sentence_test
}  // namespace etude::language
