// SPDX-License-Identifier: Apache-2.0
// Tests services/language/meaning.cc: what the grammar says is understood as it was meant.
#include "services/language/meaning.h"

#include <gmock/gmock.h>

#include "services/core/rng.h"
#include "services/language/held_out.h"

namespace etude::language {
namespace meaning_test {

using testing::ElementsAre;
using testing::HasSubstr;

const std::vector<std::string>& Objects() {
  static const std::vector<std::string> objects{"cube", "coke", "pepsi", "milk", "bread", "bottle"};
  return objects;
}

const MeaningParser& Parser() {
  static const auto parser = MeaningParser::Load({"pick", "push", "put_down"}, Objects());
  EXPECT_TRUE(parser) << parser.error().message;
  return *parser;
}

TEST(Meaning, IsThatOfEveryTemplate) {
  const auto grammar = Grammar::Load();
  ASSERT_TRUE(grammar);
  for (const char* task : {"pick", "push", "put_down", "rotate"})
    for (const auto& object : Objects())
      for (const auto& sentence : grammar->Templates({.task = task, .target = object})) {
        const Meaning meaning = Parser().Parse(sentence);
        ASSERT_TRUE(meaning.command) << sentence << ": " << meaning.why;
        EXPECT_EQ(meaning.task(), task) << sentence;
        EXPECT_EQ(meaning.command->target, object) << sentence;
        EXPECT_EQ(meaning.why, "");
      }
}

TEST(Meaning, IsThatOfVariedSentencesToo) {
  const auto grammar = Grammar::Load();
  ASSERT_TRUE(grammar);
  Rng rng(7);
  int understood = 0, said = 0;
  for (const char* task : {"pick", "push", "put_down"})
    for (const auto& object : Objects())
      for (int i = 0; i < 20; ++i) {
        const std::string sentence = grammar->Sample({.task = task, .target = object}, Style::kVaried, rng);
        const Meaning meaning = Parser().Parse(sentence);
        ++said;
        if (!meaning.command) continue;
        ++understood;
        EXPECT_EQ(meaning.task(), task) << sentence;
        EXPECT_EQ(meaning.command->target, object) << sentence;
      }
  EXPECT_GE(understood, said * 95 / 100);
}

TEST(Meaning, OfARelationNamesBothObjects) {
  const auto grammar = Grammar::Load();
  ASSERT_TRUE(grammar);
  for (const char* task : {"place_left", "place_right", "place_front", "place_behind"})
    for (const auto& sentence : grammar->Templates({.task = task, .target = "coke", .reference = "milk"})) {
      const Meaning meaning = Parser().Parse(sentence);
      ASSERT_TRUE(meaning.command) << sentence << ": " << meaning.why;
      EXPECT_EQ(meaning.task(), task) << sentence;
      EXPECT_EQ(meaning.command->target, "coke") << sentence;
      EXPECT_EQ(meaning.command->reference, "milk") << sentence;
    }
}

// before, whatever was said of where a thing stands made a relation of it
TEST(Meaning, APlaceMaySayWhichThingIsMeant) {
  for (const auto& [sentence, task, target] : {std::tuple{"pick up the bottle behind the coke", "pick", "bottle"},
                                               {"pick up the coke on the table", "pick", "coke"},
                                               {"push the milk to the left of the bread", "push", "milk"}}) {
    const Meaning meaning = Parser().Parse(sentence);
    ASSERT_TRUE(meaning.command) << sentence << ": " << meaning.why;
    EXPECT_EQ(meaning.task(), task) << sentence;
    EXPECT_EQ(meaning.command->target, target) << sentence;
    EXPECT_EQ(meaning.command->reference, "") << sentence;
  }
}

TEST(Meaning, KnowsWhatIsToBeKeptOff) {
  const auto grammar = Grammar::Load();
  ASSERT_TRUE(grammar);
  for (const auto& [obstacle, task] :
       {std::pair{std::string(kEverythingElse), "push+others"}, {std::string("basketball"), "push+obstacle"}})
    for (const auto& sentence : grammar->Templates({.task = "push", .target = "pepsi", .obstacle = obstacle})) {
      const Meaning meaning = Parser().Parse(sentence);
      ASSERT_TRUE(meaning.command) << sentence << ": " << meaning.why;
      EXPECT_EQ(meaning.task(), task) << sentence;
      EXPECT_EQ(meaning.command->target, "pepsi") << sentence;
    }
}

// Training says so of any thing of the scene; what is to be kept off is not what is to be moved.
TEST(Meaning, KeepingOffAThingOfTheTableIsNotTakenForTheTarget) {
  for (const char* sentence : {"pick bread without touching milk carton", "push coke can and avoid the bottle"}) {
    const Meaning meaning = Parser().Parse(sentence);
    EXPECT_FALSE(meaning.command) << sentence;
    EXPECT_THAT(meaning.why, HasSubstr("keeping off")) << sentence;
  }
}

TEST(Meaning, OfWhatIsNotSaidIsNotGuessed) {
  EXPECT_FALSE(Parser().Parse("").command);
  const Meaning no_verb = Parser().Parse("the red can");
  EXPECT_FALSE(no_verb.command);
  EXPECT_THAT(no_verb.why, HasSubstr("verb"));
  const Meaning no_object = Parser().Parse("push the elephant");
  EXPECT_FALSE(no_object.command);
  EXPECT_THAT(no_object.why, HasSubstr("object"));
  EXPECT_THAT(no_object.unseen(), ElementsAre("elephant"));
}

TEST(Meaning, IsOfObjectsOnTheTableAlone) {
  EXPECT_TRUE(Parser().Parse("push the milk").command);
  EXPECT_FALSE(Parser().Parse("push the milk", {"coke", "bread"}).command);
}

TEST(Meaning, TellsWhichWordsTrainingNeverSays) {
  const Meaning meaning = Parser().Parse("Push the xylophonic MILK, please!");
  std::vector<std::string> words;
  for (const auto& word : meaning.words) words.push_back(word.text);
  EXPECT_THAT(words, ElementsAre("push", "the", "xylophonic", "milk", "please"));
  EXPECT_THAT(meaning.unseen(), ElementsAre("xylophonic"));
  const OrderedJson json = ToJson(meaning);
  EXPECT_EQ(json["words"][2]["seen"], false);
  EXPECT_EQ(json["target"], "milk");
}

TEST(Meaning, TakesTheWordsOfAnotherTrainingWhereTheyAreKnown) {
  Meaning meaning = Parser().Parse("push the xylophonic milk");
  MarkSeen(meaning, WordsIn(WordsText({"push", "xylophonic", "the"})));
  EXPECT_THAT(meaning.unseen(), ElementsAre("milk"));
  EXPECT_EQ(meaning.command->target, "milk") << "what it means stays";
  EXPECT_TRUE(WordsIn(WordsText({})).empty());
}

}  // namespace meaning_test
}  // namespace etude::language
