// SPDX-License-Identifier: Apache-2.0
// Tests services/language/grammar.cc, lexicon.cc and wordnet.cc
#include "services/language/grammar.h"

#include <gmock/gmock.h>

#include <set>

#include "services/language/lexicon.h"
#include "services/language/tokenizer.h"

namespace etude::language {
namespace {

using ::testing::Contains;
using ::testing::Not;

Grammar LoadGrammar() {
  auto grammar = Grammar::Load();
  EXPECT_TRUE(grammar.has_value());
  return *grammar;
}

TEST(Grammar, HasThe232SentencesOfTheOriginal) {
  const Grammar grammar = LoadGrammar();
  std::set<std::string> sentences;
  for (const auto& task : grammar.tasks())
    for (const auto& object : grammar.objects())
      for (const auto& sentence : grammar.Templates({task, object})) sentences.insert(sentence);
  EXPECT_EQ(sentences.size(), 232u);
  EXPECT_THAT(sentences, Contains("pick up red can"));
  EXPECT_THAT(sentences, Contains("put down bottle"));
}

TEST(Grammar, TemplateSamplesAreTemplates) {
  const Grammar grammar = LoadGrammar();
  Rng rng(3);
  const auto templates = grammar.Templates({"push", "pepsi"});
  std::set<std::string> drawn;
  for (int i = 0; i < 500; ++i) drawn.insert(grammar.Sample({"push", "pepsi"}, Style::kTemplate, rng));
  EXPECT_EQ(drawn, std::set<std::string>(templates.begin(), templates.end()));
}

TEST(Grammar, VariedSamplesNeverMeetTheHeldOutTables) {
  const Grammar grammar = LoadGrammar();
  std::set<std::string> sentences;
  for (const auto& sentence : HeldOutSentences()) {
    sentences.insert(sentence.text);
    EXPECT_THAT(grammar.tasks(), Contains(sentence.task));
    EXPECT_THAT(grammar.objects(), Contains(sentence.object));
  }
  ASSERT_EQ(sentences.size(), 30u);
  ASSERT_EQ(HeldOutNounPhrases().size(), 50u);
  Rng rng(5);
  for (const auto& task : grammar.tasks()) {
    for (const auto& object : grammar.objects()) {
      for (int i = 0; i < 3000; ++i) {
        const auto text = Normalize(grammar.Sample({task, object}, Style::kVaried, rng));
        ASSERT_FALSE(sentences.contains(text)) << text;
        for (const auto& phrase : HeldOutNounPhrases())
          ASSERT_FALSE(text.ends_with("the " + phrase) || text == "push " + phrase) << text;
      }
    }
  }
}

TEST(Grammar, DrawsSynonymsOfWordNet) {
  const Grammar grammar = LoadGrammar();
  Rng rng(7);
  std::set<std::string> words;
  for (int i = 0; i < 3000; ++i) {
    std::string text = grammar.Sample({"pick", "coke"}, Style::kVaried, rng);
    for (std::size_t at; (at = text.find(' ')) != std::string::npos; text = text.substr(at + 1))
      words.insert(text.substr(0, at));
  }
  EXPECT_THAT(words, Contains("elevate"));  // a lemma of the sense "lift"
  EXPECT_THAT(words, Contains("scarlet"));  // a lemma of the sense "red"
  EXPECT_THAT(words, Not(Contains("push")));
}

TEST(Grammar, IsAPureFunctionOfTheGenerator) {
  const Grammar grammar = LoadGrammar();
  Rng a(11), b(11);
  for (int i = 0; i < 200; ++i)
    EXPECT_EQ(grammar.Sample({"put_down", "milk"}, Style::kNoisy, a),
              grammar.Sample({"put_down", "milk"}, Style::kNoisy, b));
}

TEST(WordNet, NamesWhatIsMissing) {
  EXPECT_EQ(SynsetLemmas("/nowhere", {"verb", 1974080, "lift"}).error().code, Code::kNotFound);
  EXPECT_EQ(SynsetLemmas(kWordNetFolder, {"verb", 1974080, "sleep"}).error().code, Code::kCorrupt);
  EXPECT_EQ(SynsetLemmas(kWordNetFolder, {"verb", 1974081, "lift"}).error().code, Code::kCorrupt);
  EXPECT_EQ(SynsetLemmas(kWordNetFolder, {"verb", 999999999, "lift"}).error().code, Code::kCorrupt);
}

}  // namespace
}  // namespace etude::language
