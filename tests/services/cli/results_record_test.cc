// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/results_record.cc
#include "services/cli/results_record.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace results_record_test {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

ResultRow Row(const std::string& name) {
  ResultRow row;
  row.name = name;
  row.data = {.campaign = "quickstart", .episodes = 600};
  row.train.minutes = 10;
  row.train.seeds = {1, 2, 3};
  return row;
}

ResultReport Report(std::uint64_t seed, int successes) {
  return {seed, "a day, a machine", {{"overall", {{"n", 10}, {"successes", successes}}}}};
}

std::vector<std::uint64_t> SeedsOf(const std::vector<ResultReport>& reports) {
  std::vector<std::uint64_t> seeds;
  for (const auto& report : reports) seeds.push_back(report.seed);
  return seeds;
}

TEST(ResultRecords, KeepRowsOfSeveralDaysInOneFile) {
  const TemporaryFolder folder;
  const Path file = folder.path() / "results.json";
  auto records = ResultRecords::Load(file);
  ASSERT_TRUE(records) << "no file is no error: " << records.error().message;
  records->Keep(Row("a"), Report(3, 7));
  ASSERT_TRUE(records->Save(file));

  auto later = ResultRecords::Load(file);
  ASSERT_TRUE(later) << later.error().message;
  later->Keep(Row("b"), Report(1, 5));
  later->Keep(Row("a"), Report(1, 8));
  ASSERT_TRUE(later->Save(file));

  const auto whole = ResultRecords::Load(file);
  ASSERT_TRUE(whole) << whole.error().message;
  EXPECT_EQ(SeedsOf(whole->Find(Row("a"))), (std::vector<std::uint64_t>{1, 3})) << "in order of the seeds";
  ASSERT_EQ(whole->Find(Row("b")).size(), 1U);
  EXPECT_EQ(whole->Find(Row("b"))[0].made, "a day, a machine");
  EXPECT_THAT(whole->Find(Row("c")), IsEmpty());
}

TEST(ResultRecords, AnotherMeasurementOfASeedTakesThePlaceOfTheFirst) {
  ResultRecords records;
  records.Keep(Row("a"), Report(2, 7));
  records.Keep(Row("a"), Report(2, 9));
  const auto found = records.Find(Row("a"));
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].report["overall"]["successes"], 9);
}

// each run of the command reads every report again: only a new one is of today and of this machine
TEST(ResultRecords, WhatIsReadAgainKeepsItsDayAndMachine) {
  ResultRecords records;
  records.Keep(Row("a"), Report(1, 7));
  ResultReport again = Report(1, 7);
  again.made = "a later day, another machine";
  records.Keep(Row("a"), again);
  ASSERT_EQ(records.Find(Row("a")).size(), 1U);
  EXPECT_EQ(records.Find(Row("a"))[0].made, "a day, a machine");

  ResultReport other = Report(1, 8);
  other.made = "a later day, another machine";
  records.Keep(Row("a"), other);
  ASSERT_EQ(records.Find(Row("a")).size(), 1U);
  EXPECT_EQ(records.Find(Row("a"))[0].made, "a later day, another machine");
  again.seed = 2;
  records.Keep(Row("a"), again);
  EXPECT_EQ(records.Find(Row("a")).size(), 2U) << "another seed may end alike";
}

// what was measured before this was known gets it, and does not lose it with the folder that it was read from
TEST(ResultRecords, WhatIsReadAgainAddsWhatIsKnownOfTheTrainingAndAComparisonThatCameLater) {
  ResultRecords records;
  records.Keep(Row("a"), Report(1, 7));
  ResultReport known = Report(1, 7);
  known.made = "a later day, another machine";
  known.report["comparison"] = {{"overall", {{"n", 10}}}, {"with", "b"}};
  known.training_s = 276;
  known.train = 80;
  known.valid = 20;
  records.Keep(Row("a"), known);
  const auto found = records.Find(Row("a"));
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].made, "a day, a machine");
  EXPECT_EQ(found[0].report, known.report);
  EXPECT_EQ(found[0].training_s, 276);

  records.Keep(Row("a"), Report(1, 7));
  const auto kept = records.Find(Row("a"));
  ASSERT_EQ(kept.size(), 1U);
  EXPECT_EQ(kept[0].training_s, 276);
  EXPECT_EQ(kept[0].train, 80U);
  EXPECT_EQ(kept[0].valid, 20U);
  EXPECT_EQ(kept[0].report, known.report) << "with its comparison";
}

// the other row's evaluation may lie in a folder that is not there
TEST(ResultRecords, AComparisonThatCannotBeMadeAgainIsKeptOfTheSameRowAndRollouts) {
  ResultReport compared = Report(1, 7), missing = compared;
  compared.report["comparison"] = {{"overall", {{"n", 10}}}, {"with", "b"}, {"with_sha256", "2f"}};
  missing.report["comparison"] = {{"missing", "not there"}, {"with", "b"}};
  const auto kept = [&](const ResultReport& now) {
    ResultRecords records;
    records.Keep(Row("a"), compared);
    records.Keep(Row("a"), now);
    return records.Find(Row("a")).at(0).report;
  };
  EXPECT_EQ(kept(missing), compared.report);
  ResultReport other_row = missing, other_rollouts = missing, again = compared;
  other_row.report["comparison"]["with"] = "c";
  EXPECT_EQ(kept(other_row), other_row.report);
  other_rollouts.report["overall"]["successes"] = 8;
  EXPECT_EQ(kept(other_rollouts), other_rollouts.report);
  again.report["comparison"]["overall"]["n"] = 9;
  EXPECT_EQ(kept(again), again.report) << "the later one";
}

// a row that is defined anew must not show, or be averaged with, what was measured before
TEST(ResultRecords, NeverMixTwoDefinitionsOfARow) {
  ResultRecords records;
  records.Keep(Row("a"), Report(1, 7));
  ResultRow longer = Row("a");
  longer.train.minutes = 20;
  EXPECT_THAT(records.Find(longer), IsEmpty());
  records.Keep(longer, Report(2, 9));
  EXPECT_EQ(SeedsOf(records.Find(longer)), (std::vector<std::uint64_t>{2}));
  EXPECT_THAT(records.Find(Row("a")), IsEmpty());

  ResultRow other_scenes = longer;
  other_scenes.eval.seed = 77;
  EXPECT_THAT(records.Find(other_scenes), IsEmpty());
}

// the data may have been removed since, while the run is still there to be evaluated
TEST(ResultRecords, WhatIsKnownOfATrainingStaysWhereOnlyTheEvaluationIsDefinedAnew) {
  ResultRecords records;
  ResultReport known = Report(1, 7);
  known.training_s = 276;
  known.train = 80;
  known.valid = 20;
  records.Keep(Row("a"), known);
  ResultRow other_scenes = Row("a");
  other_scenes.eval.seed = 77;
  records.Keep(other_scenes, Report(1, 9));
  const auto kept = records.Find(other_scenes);
  ASSERT_EQ(kept.size(), 1U);
  EXPECT_EQ(kept[0].report["overall"]["successes"], 9);
  EXPECT_EQ(kept[0].training_s, 276);
  EXPECT_EQ(kept[0].train, 80U);
  EXPECT_EQ(kept[0].valid, 20U);

  ResultRow longer = other_scenes;
  longer.train.minutes = 20;
  records.Keep(longer, Report(1, 9));
  ASSERT_EQ(records.Find(longer).size(), 1U);
  EXPECT_EQ(records.Find(longer)[0].train, 0U) << "another training";
}

TEST(ResultRecords, WordsGoalAndSeedsOfARowAreNotItsDefinition) {
  ResultRecords records;
  records.Keep(Row("a"), Report(1, 7));
  ResultRow reworded = Row("a");
  reworded.title = "in other words";
  reworded.paper = "82.4";
  reworded.goal = 95;
  reworded.goals = {{"latched", 82.4}, {"TAR3D", 0.2}};
  reworded.compare = "b";
  reworded.train.seeds = {1, 2, 3, 4};
  EXPECT_EQ(records.Find(reworded).size(), 1U);
}

TEST(ResultRecords, RefuseAFileThatIsNoneOfTheirs) {
  const TemporaryFolder folder;
  const Path file = folder.path() / "results.json";
  ASSERT_TRUE(WriteFileAtomically(file, std::string_view("not json")));
  const auto text = ResultRecords::Load(file);
  ASSERT_FALSE(text);
  EXPECT_THAT(text.error().message, HasSubstr("move it away"));
  ASSERT_TRUE(WriteFileAtomically(file, std::string_view("{\"lines\": []}")));
  const auto other = ResultRecords::Load(file);
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().message, HasSubstr("lines"));
}

// the file of an earlier version has every key it knew, defaults too, and not those that came since
TEST(ResultRecords, FindWhatAnEarlierVersionWrote) {
  OrderedJson written = DefinitionOf(Row("a"));
  written["train"]["seeds"] = OrderedJson::array();
  written["train"]["config"] = "compact";
  written["eval"]["scenes"] = "";
  written["eval"]["episodes"] = 400;
  ResultRecords records{{{"a", written, {Report(1, 7)}}}};
  EXPECT_EQ(SeedsOf(records.Find(Row("a"))), (std::vector<std::uint64_t>{1}));
  records.Keep(Row("a"), Report(2, 8));
  EXPECT_EQ(SeedsOf(records.Find(Row("a"))), (std::vector<std::uint64_t>{1, 2}));
  ResultRow fewer = Row("a");
  fewer.eval.episodes = 100;
  EXPECT_THAT(records.Find(fewer), IsEmpty());
}

// another base is another row, however alike what was done on top of it is
TEST(ResultRecords, TheRowThatItBeginsWithIsPartOfADefinition) {
  ResultRow row = Row("a"), other = Row("a");
  row.train.init = other.train.init = "base";
  row.begins_with = DefinitionOf(Row("base"));
  ResultRow longer = Row("base");
  longer.train.minutes = 25;
  other.begins_with = DefinitionOf(longer);
  ResultRecords records;
  records.Keep(row, Report(1, 7));
  EXPECT_EQ(records.Find(row).size(), 1U);
  EXPECT_THAT(records.Find(other), IsEmpty());
}

// another seed for the base's scenes asked for every row on top of it to be trained again
TEST(ResultRecords, WhereTheBaseWasRolledOutIsNoPartOfADefinition) {
  ResultRow row = Row("a"), other = Row("a");
  ResultRow base = Row("base");
  row.train.init = other.train.init = "base";
  row.begins_with = DefinitionOf(base);
  base.eval.seed = 99;
  other.begins_with = DefinitionOf(base);
  ResultRecords records;
  records.Keep(row, Report(1, 7));
  EXPECT_EQ(records.Find(other).size(), 1U);
}

// what would be left out of the table without a word
TEST(ResultRecords, TheShippedFiguresAreOfTheRowsAsTheyAreDefined) {
  const auto config = LoadResults("deploy/docs/results.yaml");
  ASSERT_THAT(config, IsOk());
  const auto records = ResultRecords::Load("deploy/docs/results.json");
  ASSERT_THAT(records, IsOk());
  ASSERT_FALSE(records->rows.empty());
  for (const auto& record : records->rows) {
    const auto row = std::ranges::find(config->rows, record.row, &ResultRow::name);
    ASSERT_NE(row, config->rows.end()) << record.row;
    EXPECT_EQ(records->Find(*row).size(), record.reports.size()) << record.row;
  }
}

TEST(Definition, IsKeptBesideWhatWasMadeOfIt) {
  const TemporaryFolder out;
  EXPECT_THAT(CheckDefinition(out.path(), Row("a")), IsOk()) << "nothing was made";
  ASSERT_THAT(KeepDefinition(out.path(), Row("a")), IsOk());
  EXPECT_THAT(KeepDefinition(out.path(), Row("a")), IsOk());
  ResultRow reworded = Row("a");
  reworded.goal = 95;
  reworded.train.seeds = {4};
  EXPECT_THAT(CheckDefinition(out.path(), reworded), IsOk());
  EXPECT_THAT(CheckDefinition(out.path(), Row("b")), IsOk()) << "each row has its own";
}

// what was made before the step that is another one stays good
TEST(Definition, AnotherOneSaysWhatToRemove) {
  const TemporaryFolder out;
  ASSERT_THAT(KeepDefinition(out.path(), Row("a")), IsOk());
  ResultRow scenes = Row("a"), longer = Row("a"), data = Row("a");
  scenes.eval.seed = 77;
  longer.train.minutes = 20;
  data.data.set = {"randomization.world.distractors=2"};
  data.data.name = "shared";
  for (const auto* row : {&scenes, &longer, &data}) {
    EXPECT_THAT(KeepDefinition(out.path(), *row), HasCode(Code::kInvalidArgument));
    EXPECT_THAT(CheckDefinition(out.path(), *row), MessageHas("rows/a.json, eval/a-[0-9]*"));
    EXPECT_THAT(CheckDefinition(out.path(), *row), MessageHas("--out"));
  }
  EXPECT_THAT(CheckDefinition(out.path(), scenes), Not(MessageHas("runs/a")));
  EXPECT_THAT(CheckDefinition(out.path(), longer), MessageHas("runs/a-[0-9]*"));
  EXPECT_THAT(CheckDefinition(out.path(), longer), Not(MessageHas("data/")));
  EXPECT_THAT(CheckDefinition(out.path(), data), MessageHas("runs/a-[0-9]*, data/shared"));
  EXPECT_THAT(CheckDefinition(out.path(), Row("a")), IsOk()) << "the file is as it was";
}

TEST(Definition, AFileThatHoldsNoneIsAnotherOne) {
  const TemporaryFolder out;
  ASSERT_THAT(WriteFileAtomically(out / "rows/a.json", std::string_view("not json")), IsOk());
  EXPECT_THAT(CheckDefinition(out.path(), Row("a")), MessageHas("runs/a-[0-9]*, data/a"));
}

TEST(MadeHere, NamesADayAndAMachine) {
  EXPECT_THAT(MadeHere(), testing::MatchesRegex("20..-..-.., .+, [0-9]+ CPUs"));
#if defined(__x86_64__)
  EXPECT_THAT(MadeHere(), testing::Not(testing::HasSubstr("unknown")));
#endif
}

}  // namespace results_record_test
}  // namespace etude::cli
