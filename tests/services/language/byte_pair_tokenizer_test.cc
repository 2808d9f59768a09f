// SPDX-License-Identifier: Apache-2.0
// Tests services/language/byte_pair_tokenizer.cc against examples that were worked by hand.
#include "services/language/byte_pair_tokenizer.h"

#include <gmock/gmock.h>

#include "services/core/config.h"
#include "tests/support/matchers.h"

namespace etude::language {
namespace byte_pair_tokenizer_test {

using Symbols = std::vector<std::string>;

constexpr char kMerges[] =
    "#version: 0.2\n"
    "l o\n"
    "e r</w>\n"
    "lo w\n"
    "lo w</w>\n"
    "a a\n";

/// A vocabulary of few symbols, and sentences as those symbols.
class Tokens {
 public:
  explicit Tokens(const std::string& merges = kMerges, const Symbols& more = {}) {
    for (char c = 'a'; c <= 'z'; ++c) AddBoth(std::string(1, c));
    for (char c = '0'; c <= '9'; ++c) Add(std::string(1, c) + "</w>");
    for (const char* mark : {"!", "'", "-", "<", "|", ">"}) AddBoth(mark);
    for (const char* symbol : {"lo", "low", "low</w>", "er</w>", "aa"}) Add(symbol);
    for (const auto& symbol : more) Add(symbol);
    Add("<|startoftext|>");
    Add("<|endoftext|>");
    auto parsed = BytePairTokenizer::Parse(ids_.dump(), merges);
    EXPECT_THAT(parsed, IsOk());
    if (parsed) tokenizer_.emplace_back(std::move(*parsed));
  }

  const BytePairTokenizer& tokenizer() const { return tokenizer_.at(0); }
  /// What lies between start and end.
  Symbols Of(const std::string& sentence) const {
    const auto ids = tokenizer().Encode(sentence);
    Symbols symbols;
    for (const auto id : ids) symbols.push_back(symbols_.at(static_cast<std::size_t>(id)));
    EXPECT_GE(symbols.size(), 2u);
    EXPECT_EQ(symbols.front(), "<|startoftext|>");
    EXPECT_EQ(symbols.back(), "<|endoftext|>");
    return {symbols.begin() + 1, symbols.end() - 1};
  }

 private:
  void Add(const std::string& symbol) {
    ids_[symbol] = symbols_.size();
    symbols_.push_back(symbol);
  }
  void AddBoth(const std::string& symbol) {
    Add(symbol);
    Add(symbol + "</w>");
  }

  Json ids_ = Json::object();
  Symbols symbols_;
  std::vector<BytePairTokenizer> tokenizer_;  // one
};

TEST(BytePairTokenizer, MergesThePairThatWasLearnedFirstWhereverItStands) {
  const Tokens tokens;
  EXPECT_EQ(tokens.Of("low"), Symbols({"low</w>"}));
  EXPECT_EQ(tokens.Of("lower"), Symbols({"low", "er</w>"}));
  EXPECT_EQ(tokens.Of("lowlow"), Symbols({"low", "low</w>"}));
  EXPECT_EQ(tokens.Of("slow"), Symbols({"s", "low</w>"}));
  EXPECT_EQ(tokens.Of("owl"), Symbols({"o", "w", "l</w>"}));
  EXPECT_EQ(tokens.Of("aaaa"), Symbols({"aa", "a", "a</w>"})) << "the last one ends the word, it is another symbol";
  EXPECT_EQ(tokens.Of("aaaaa"), Symbols({"aa", "aa", "a</w>"}));
}

TEST(BytePairTokenizer, TheOrderOfTheMergesDecides) {
  const Symbols more{"ab", "bc</w>"};
  EXPECT_EQ(Tokens("#version: 0.2\na b\nb c</w>\n", more).Of("abc"), Symbols({"ab", "c</w>"}));
  EXPECT_EQ(Tokens("#version: 0.2\nb c</w>\na b\n", more).Of("abc"), Symbols({"a", "bc</w>"}));
  // what stands twice keeps its first place
  EXPECT_EQ(Tokens("#version: 0.2\nb c</w>\na b\nb c</w>\n", more).Of("abc"), Symbols({"a", "bc</w>"}));
}

TEST(BytePairTokenizer, ReadsLinesOfWindowsAndALastOneWithoutItsEnd) {
  const Symbols more{"ab", "##"};
  const Tokens tokens("#version: 0.2\r\na b\r\n\r\nl o", more);
  EXPECT_EQ(tokens.Of("abc"), Symbols({"ab", "c</w>"}));
  EXPECT_EQ(tokens.Of("lot"), Symbols({"lo", "t</w>"}));
  // only the first line may be about the version
  EXPECT_EQ(Tokens("#version: 0.2\n# #\n", {"#", "#</w>", "##"}).Of("###"), Symbols({"##", "#</w>"}));
}

TEST(BytePairTokenizer, LowersAndSkipsSpaces) {
  const Tokens tokens;
  EXPECT_EQ(tokens.Of("  LOW \t\r\n low  "), Symbols({"low</w>", "low</w>"}));
  EXPECT_EQ(tokens.Of("low\u00A0low\u3000low"), Symbols({"low</w>", "low</w>", "low</w>"}));
  EXPECT_EQ(tokens.Of(""), Symbols());
  EXPECT_EQ(tokens.Of(" \n "), Symbols());
}

TEST(BytePairTokenizer, SplitsWordsPunctuationAndEveryDigit) {
  const Tokens tokens;
  EXPECT_EQ(tokens.Of("low!!-low"), Symbols({"low</w>", "!", "!", "-</w>", "low</w>"}));
  EXPECT_EQ(tokens.Of("!low"), Symbols({"!</w>", "low</w>"}));
  EXPECT_EQ(tokens.Of("42"), Symbols({"4</w>", "2</w>"}));
  EXPECT_EQ(tokens.Of("a1b"), Symbols({"a</w>", "1</w>", "b</w>"}));
  EXPECT_EQ(tokens.Of("- -"), Symbols({"-</w>", "-</w>"}));
}

TEST(BytePairTokenizer, KeepsEnglishEndingsTogether) {
  const Tokens tokens;
  EXPECT_EQ(tokens.Of("it's"), Symbols({"i", "t</w>", "'", "s</w>"}));
  EXPECT_EQ(tokens.Of("DON'T"), Symbols({"d", "o", "n</w>", "'", "t</w>"}));
  EXPECT_EQ(tokens.Of("we're"), Symbols({"w", "e</w>", "'", "r", "e</w>"}));
  EXPECT_EQ(tokens.Of("i've"), Symbols({"i</w>", "'", "v", "e</w>"}));
  EXPECT_EQ(tokens.Of("i'm"), Symbols({"i</w>", "'", "m</w>"}));
  EXPECT_EQ(tokens.Of("i'll"), Symbols({"i</w>", "'", "l", "l</w>"}));
  EXPECT_EQ(tokens.Of("i'd"), Symbols({"i</w>", "'", "d</w>"}));
  // not one of them: an apostrophe, then a word
  EXPECT_EQ(tokens.Of("'low'"), Symbols({"'</w>", "low</w>", "'</w>"}));
  EXPECT_EQ(tokens.Of("'n"), Symbols({"'</w>", "n</w>"}));
  // the ending is split off whatever follows, but not out of a run of marks
  EXPECT_EQ(tokens.Of("'slow"), Symbols({"'", "s</w>", "low</w>"}));
  EXPECT_EQ(tokens.Of("!'s"), Symbols({"!", "'</w>", "s</w>"}));
}

TEST(BytePairTokenizer, SpellsWhatIsNotAsciiInBytes) {
  // U+00C3 and U+00A9 stand for themselves; the 34th byte that does not print is 0x7F, the last one 0xAD
  const Tokens tokens(kMerges, {"Ã", "©</w>", "©", "ÿ</w>", "Ā</w>", "ġ</w>", "Â", "Ń</w>", "Ġ"});
  EXPECT_EQ(tokens.Of("É"), Symbols({"Ã", "©</w>"})) << "é is C3 A9";
  EXPECT_EQ(tokens.Of("été"), Symbols({"Ã", "©", "t", "Ã", "©</w>"}));
  EXPECT_EQ(tokens.Of("low\xFF"), Symbols({"low</w>", "ÿ</w>"})) << "a byte that is no UTF-8";
  EXPECT_EQ(tokens.Of(std::string("\0", 1)), Symbols({"Ā</w>"}));
  EXPECT_EQ(tokens.Of("\x7F"), Symbols({"ġ</w>"}));
  EXPECT_EQ(tokens.Of("\u00AD"), Symbols({"Â", "Ń</w>"})) << "the soft hyphen is C2 AD";
}

TEST(BytePairTokenizer, WhatTheVocabularyLacksIsTheEndToken) {
  const Tokens tokens;
  EXPECT_EQ(tokens.Of("low?"), Symbols({"low</w>", "<|endoftext|>"}));
  EXPECT_EQ(tokens.Of("\xFE"), Symbols({"<|endoftext|>"}));
}

TEST(BytePairTokenizer, NamesOfTokensInASentenceAreText) {
  const Symbols symbols = Tokens().Of("<|endoftext|>");
  EXPECT_EQ(symbols, Symbols({"<", "|</w>", "e", "n", "d", "o", "f", "t", "e", "x", "t</w>", "|", "></w>"}));
}

TEST(BytePairTokenizer, KnowsItsOwnIds) {
  const std::string vocabulary = R"({"b</w>": 7, "<|endoftext|>": 3, "<|startoftext|>": 9})";
  const auto tokenizer = BytePairTokenizer::Parse(vocabulary, "#version: 0.2\n");
  ASSERT_THAT(tokenizer, IsOk());
  EXPECT_THAT(tokenizer->Encode("b B"), testing::ElementsAre(9, 7, 7, 3));
  EXPECT_EQ(tokenizer->end_token(), 3);
  EXPECT_EQ(tokenizer->largest_id(), 9);
}

TEST(BytePairTokenizer, RefusesFilesThatAreNotWhatTheyShouldBe) {
  const std::string good = R"({"a": 0, "b</w>": 1, "<|startoftext|>": 2, "<|endoftext|>": 3})";
  const std::string merges = "#version: 0.2\n";
  const auto refused = [&](const std::string& vocabulary, const std::string& lines, const char* reason) {
    const auto tokenizer = BytePairTokenizer::Parse(vocabulary, lines);
    EXPECT_THAT(tokenizer, HasCode(Code::kCorrupt));
    EXPECT_THAT(tokenizer, MessageHas(reason));
  };
  ASSERT_THAT(BytePairTokenizer::Parse(good, merges), IsOk());
  refused("", merges, "vocab.json is not a JSON map");
  refused("[1, 2]", merges, "vocab.json is not a JSON map");
  refused(std::string(100'000, '['), merges, "vocab.json is not a JSON map");
  refused(R"({"a": -1})", merges, "'a' has no id");
  refused(R"({"a": "1"})", merges, "'a' has no id");
  refused(R"({"a": 16777216})", merges, "'a' has no id");
  refused(R"({"a": 0, "<|endoftext|>": 3})", merges, "vocab.json has no '<|startoftext|>'");
  refused(R"({"a": 0, "<|startoftext|>": 3})", merges, "vocab.json has no '<|endoftext|>'");
  refused(good, "", "does not begin with a line '#version'");
  refused(good, "a b</w>\n", "does not begin with a line '#version'");
  refused(good, merges + "a\n", "merges.txt:2: 'a' is not two symbols");
  refused(good, merges + "a b c\n", "merges.txt:2: 'a b c' is not two symbols");
  refused(good, merges + "\na b</w>\n", "merges.txt:3: 'a b</w>' makes 'ab</w>', which vocab.json lacks");
}

}  // namespace byte_pair_tokenizer_test
}  // namespace etude::language
