// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/sentence_suite.cc
#include "services/cli/sentence_suite.h"

#include <gmock/gmock.h>

#include <set>

#include "services/cli/evaluation.h"
#include "services/language/held_out.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace sentence_suite_test {

using testing::ElementsAre;

class SentenceFile : public testing::Test {
 protected:
  Result<std::vector<SentenceSpec>> Load(const std::string& text) {
    EXPECT_TRUE(WriteFileAtomically(folder_ / "mine.txt", std::string_view(text)));
    return LoadSentences((folder_ / "mine.txt").string());
  }
  TemporaryFolder folder_;
};

TEST(SentenceSuite, TablesAreThePapersAndFitAnEvaluation) {
  const auto table8 = LoadSentences("table8"), table11 = LoadSentences("table11");
  ASSERT_THAT(table8, IsOk());
  ASSERT_THAT(table11, IsOk());
  EXPECT_EQ(table8->size(), 50u);
  EXPECT_EQ(table11->size(), 30u);
  EXPECT_EQ(table8->front(), (SentenceSpec{"push skimmed milk package", "push", "milk", ""}));
  EXPECT_EQ(table11->front(), (SentenceSpec{"grab the loafs", "pick", "bread", ""}));
  std::set<std::string> pushed;
  for (const auto& sentence : *table8) pushed.insert(sentence.object);
  EXPECT_EQ(pushed, (std::set<std::string>{"bottle", "bread", "coke", "cube", "milk"})) << "no Pepsi there";
  for (const auto& suite : {*table8, *table11}) {
    EvaluationOptions options;
    options.run = "demo";
    options.out = "out/a";
    options.sentences = suite;
    EXPECT_THAT(EvaluationSpec(CampaignSpec(), options).Validate(), IsOk());
  }
}

TEST_F(SentenceFile, HasOneSentenceALine) {
  const auto sentences = Load(
      "# ours\n\n  pick bread:  Grab the loafs! \n"
      "place_left milk bread: the carton: left of the loaf\r\nmy/task.yaml apple: do it");
  ASSERT_THAT(sentences, IsOk());
  EXPECT_THAT(*sentences, ElementsAre(SentenceSpec{"Grab the loafs!", "pick", "bread", ""},
                                      SentenceSpec{"the carton: left of the loaf", "place_left", "milk", "bread"},
                                      SentenceSpec{"do it", "my/task.yaml", "apple", ""}));
}

TEST_F(SentenceFile, NamesTheLineThatIsNone) {
  for (const char* line : {"grab the loafs", "pick: grab the loafs",
                           "pick bread:", "pick bread:   ", "place_left milk bread coke: too many"}) {
    const auto sentences = Load(std::string("# mine\npick bread: good\n") + line + "\n");
    EXPECT_THAT(sentences, HasCode(Code::kInvalidArgument)) << line;
    EXPECT_THAT(sentences, MessageHas("mine.txt:3")) << line;
  }
  EXPECT_THAT(Load("# nothing\n"), MessageHas("no sentence"));
  EXPECT_THAT(LoadSentences((folder_ / "none").string()), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(LoadSentences("table9"), MessageHas("--sentences is table8, table11 or a file"));
}

TEST(NeverSeen, IsOfEachSentenceWhatTrainingNeverSays) {
  OrderedJson report{
      {"per_sentence", {{{"text", "Grab the loafs!"}}, {{"text", "pick up the red can"}}, {{"text", "rotate mug"}}}}};
  ASSERT_THAT(AddNeverSeen(std::nullopt, {"pick"}, {"coke", "bread"}, report), IsOk());
  EXPECT_THAT(report["per_sentence"][0]["never_seen"].get<std::vector<std::string>>(), ElementsAre("grab", "loafs"));
  EXPECT_TRUE(report["per_sentence"][1]["never_seen"].empty());
  EXPECT_THAT(report["per_sentence"][2]["never_seen"].get<std::vector<std::string>>(), ElementsAre("rotate", "mug"));

  ASSERT_THAT(AddNeverSeen(std::nullopt, {"rotate", "place_left"}, {"mug_03", "mug_04", "apple_03"}, report), IsOk());
  EXPECT_TRUE(report["per_sentence"][2]["never_seen"].empty()) << "classes, two of one too";
  EXPECT_THAT(AddNeverSeen(std::nullopt, {"pik"}, {"coke"}, report), HasCode(Code::kInvalidArgument));
  OrderedJson without = OrderedJson::object();
  ASSERT_THAT(AddNeverSeen(std::nullopt, {"pick"}, {"coke"}, without), IsOk());
  EXPECT_TRUE(without.empty());
}

// a policy of cans and bread on scenes of apples: the scenes do not say what it has heard
TEST(NeverSeen, IsMeasuredByThePolicysOwnTrainingWhereThatIsKnown) {
  OrderedJson report{{"per_sentence", {{{"text", "rotate the apple"}}}}};
  ASSERT_THAT(AddNeverSeen(std::set<std::string>{"the", "pick"}, {"rotate"}, {"apple_03"}, report), IsOk());
  EXPECT_THAT(report["per_sentence"][0]["never_seen"].get<std::vector<std::string>>(), ElementsAre("rotate", "apple"));
  EXPECT_EQ(report["words_of"], "training");
  ASSERT_THAT(AddNeverSeen(std::nullopt, {"rotate"}, {"apple_03"}, report), IsOk());
  EXPECT_TRUE(report["per_sentence"][0]["never_seen"].empty());
  EXPECT_EQ(report["words_of"], "campaign");
}

}  // namespace sentence_suite_test
}  // namespace etude::cli
