// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/results.cc: what `etude results` takes from a folder of earlier runs, and what it does not.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "services/cli/results_report.h"
#include "services/core/command.h"
#include "services/core/config.h"
#include "services/store/dataset.h"
#include "tests/support/etude_command.h"
#include "tests/support/run_command.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/write_program.h"

namespace etude {
namespace results_test {

using testing::HasSubstr;
using testing::Not;

// A folder in which row 'a' was made with training seed 7, but for what a test leaves out. Nothing here is collected,
// trained or rolled out: the campaigns do not exist.
class Results : public testing::Test {
 protected:
  CommandOutcome Make(const std::string& minutes, std::vector<std::string> more = {}) {
    const std::string rows = fmt::format(
        "rows:\n"
        "  - name: a\n    title: first\n    data: {{campaign: none.yaml}}\n"
        "    train: {{minutes: {}, seeds: [7]}}\n    eval: {{episodes: 10}}\n"
        "  - name: b\n    title: second\n    data: {{campaign: none.yaml}}\n"
        "    train: {{minutes: 5, init: a}}\n    eval: {{episodes: 10}}\n"
        "  - name: c\n    title: third\n    train: {{runs_of: a, seeds: [7]}}\n"
        "    eval: {{sentences: table8, scenes_each: 2}}\n"
        "  - name: d\n    title: fourth\n    train: {{runs_of: a, seeds: [7]}}\n"
        "    eval: {{episodes: 10}}\n    compare: a\n"
        "  - name: e\n    title: fifth\n    train: {{runs_of: a, seeds: [7]}}\n"
        "    eval: {{episodes: 10}}\n    compare: d\n",
        minutes);
    Write("results.yaml", rows);
    std::vector<std::string> arguments{"results", In("results.yaml"), "--out", In("out"), "--domain", "81"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return RunEtude(arguments, folder_ / "output.txt");
  }
  void Write(const std::string& name, const std::string& text) {
    ASSERT_TRUE(WriteFileAtomically(folder_ / name, std::string_view(text)));
  }
  void WriteReport(int done, int invalid, const std::string& row = "a") {
    const OrderedJson all{{"task", "overall"},
                          {"n", done},
                          {"success", {{"successes", done}}},
                          {"success_latched", {{"successes", done}}}};
    Write("out/eval/" + row + "-7/eval.json",
          OrderedJson({{"done", done}, {"overall", all}, {"scenes", {{"invalid", invalid}}}}).dump());
  }
  std::string In(const std::string& name) const { return (folder_ / name).string(); }

  TemporaryFolder folder_;
};

TEST_F(Results, ARowThatIsDefinedAnewIsNotTakenFromItsOldFolder) {
  Write("out/runs/a-7/whole", "\n");
  WriteReport(10, 0);
  const CommandOutcome made = Make("10", {"--row", "a"});
  ASSERT_EQ(made.exit_code, kExitOk) << made.text;
  EXPECT_THAT(made.text, HasSubstr("| first `a` | the campaign's | 10 min | scratch | 100.0 ["));

  const CommandOutcome anew = Make("20", {"--row", "a"});
  EXPECT_EQ(anew.exit_code, kExitUsage) << anew.text;
  for (const char* part : {"row 'a' is not what", "rows/a.json, eval/a-[0-9]*, runs/a-[0-9]*", "another --out"})
    EXPECT_THAT(anew.text, HasSubstr(part));
  EXPECT_THAT(anew.text, Not(HasSubstr("| first")));

  EXPECT_EQ(Make("10", {"--row", "a"}).exit_code, kExitOk) << "as it was, it is still the same row";
}

// before, such a row was measured of the earlier training and recorded as of the new one
TEST_F(Results, RunsOfARowThatIsDefinedAnewAreNotEvaluated) {
  Write("out/runs/a-7/whole", "\n");
  WriteReport(10, 0);
  WriteReport(10, 0, "d");
  ASSERT_EQ(Make("10", {"--row", "a"}).exit_code, kExitOk);

  const CommandOutcome anew = Make("20", {"--row", "d"});
  EXPECT_EQ(anew.exit_code, kExitUsage) << anew.text;
  EXPECT_THAT(anew.text, HasSubstr("row 'a' is not what"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out/rows/d.json"));

  const CommandOutcome same = Make("10", {"--row", "d"});
  EXPECT_THAT(same.text, HasSubstr("| fourth `d` |"));
}

TEST_F(Results, ATableThatCannotBeWrittenIsSaidBeforeAnythingIsMade) {
  Write("taken", "");
  const CommandOutcome made = Make("10", {"--row", "a", "--write", In("taken") + "/table.md"});
  EXPECT_NE(made.exit_code, kExitOk);
  EXPECT_THAT(made.text, HasSubstr("taken"));
  EXPECT_THAT(made.text, Not(HasSubstr("a, seed 7:")));
}

TEST_F(Results, ASeedThatNoWantedRowHasIsRefused) {
  const CommandOutcome made = Make("10", {"--row", "b", "--seeds", "7"});
  EXPECT_EQ(made.exit_code, kExitUsage) << made.text;
  EXPECT_THAT(made.text, HasSubstr("--seeds 7: none of --row b is trained with it"));
}

// before, a table that was written elsewhere or later had that day and machine
TEST_F(Results, SaysWhenAndWhereARowWasMeasured) {
  Write("out/runs/a-7/whole", "\n");
  WriteReport(10, 0);
  Write("out/eval/a-7/made", "2026-01-02, some machine, 4 CPUs\n");
  EXPECT_THAT(Make("10", {"--row", "a"}).text, HasSubstr("| 2026-01-02, some machine, 4 CPUs |"));
  const OrderedJson all{{"task", "overall"}, {"n", 10}, {"success", {{"successes", 10}}}};
  Write("out/eval/a-7/eval.json",
        OrderedJson({{"done", 10}, {"overall", all}, {"rules", {{"content", 7}, {"rollout", 5}}}}).dump());
  EXPECT_THAT(Make("10", {"--row", "a"}).text, HasSubstr("4 CPUs, content 7, rollouts 5 |"));
}

// before, a row whose options were refused had to be taken away by hand before it could be put right
TEST_F(Results, ARowOfWhichNothingWasMadeMayBePutRight) {
  EXPECT_EQ(Make("10", {"--row", "c"}).exit_code, kExitFailure) << "there is no run of 'a'";
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out/rows/c.json"));
}

// before, the table took the place of the records, which held hours of work
TEST_F(Results, RefusesToWriteTheTableOverItsRecords) {
  Write("table.json", R"({"rows": []})");
  const CommandOutcome made = Make("10", {"--row", "a", "--write", In("table.json")});
  EXPECT_EQ(made.exit_code, kExitUsage) << made.text;
  EXPECT_THAT(made.text, HasSubstr("table.md"));
  EXPECT_EQ(ReadTextFile(folder_ / "table.json").value(), R"({"rows": []})");
}

// one of ten scenes cannot be done by the expert: nine rollouts and that one are the whole evaluation
TEST_F(Results, AScenelessRolloutDoesNotStopTheTable) {
  Write("out/runs/a-7/whole", "\n");
  WriteReport(9, 1);
  const CommandOutcome made = Make("10", {"--row", "a"});
  EXPECT_EQ(made.exit_code, kExitOk) << made.text;
  EXPECT_THAT(made.text, HasSubstr("| first `a` |"));
  EXPECT_THAT(made.text, Not(HasSubstr("eval-a-7"))) << "nothing is missing";

  WriteReport(9, 0);
  const CommandOutcome missing = Make("10", {"--row", "a"});
  EXPECT_NE(missing.exit_code, kExitOk) << missing.text;
  EXPECT_THAT(missing.text, HasSubstr("eval-a-7: etude eval"));
}

TEST_F(Results, BeginsOnlyWithRunsThatCameToTheirEnd) {
  Write("out/runs/a-7/checkpoints/latest.safetensors", "stopped in the middle");
  const CommandOutcome stopped = Make("10", {"--row", "b"});
  EXPECT_EQ(stopped.exit_code, kExitFailure) << stopped.text;
  EXPECT_THAT(stopped.text, HasSubstr("row 'b' begins with 'a', of which no run of seed 7 in"));
  EXPECT_THAT(stopped.text, Not(HasSubstr("data-b"))) << "asked before anything is collected";

  // its seed is one of row a's, not of b's
  Write("out/runs/a-7/whole", "\n");
  const CommandOutcome whole = Make("10", {"--row", "b"});
  EXPECT_THAT(whole.text, HasSubstr("b, seed 1: train: etude-trainer: read '"));
  EXPECT_THAT(whole.text, HasSubstr("latest.safetensors"));
  EXPECT_THAT(whole.text, Not(HasSubstr("data-b"))) << "the trainer was asked before anything is collected";

  Write("out/rows/a.json", "{}");
  const CommandOutcome other = Make("10", {"--row", "b"});
  EXPECT_EQ(other.exit_code, kExitUsage) << other.text;
  EXPECT_THAT(other.text, HasSubstr("row 'a' is not what"));
}

// that one is the other row's beginning of that seed: what is compared with it would begin elsewhere
TEST_F(Results, ASeedThatBothRowsHaveIsNotReplacedByAnother) {
  Write("results.yaml",
        "rows:\n  - name: a\n    title: first\n    data: {campaign: none.yaml}\n"
        "    train: {minutes: 1, seeds: [7, 8]}\n    eval: {episodes: 10}\n"
        "  - name: b\n    title: second\n    data: {campaign: none.yaml}\n"
        "    train: {minutes: 5, init: a, seeds: [8]}\n    eval: {episodes: 10}\n");
  Write("out/runs/a-7/checkpoints/latest.safetensors", "whole");
  Write("out/runs/a-7/whole", "\n");
  const CommandOutcome made = RunEtude(
      {"results", In("results.yaml"), "--out", In("out"), "--domain", "81", "--row", "b"}, folder_ / "output.txt");
  EXPECT_EQ(made.exit_code, kExitFailure) << made.text;
  EXPECT_THAT(made.text, HasSubstr("row 'b' begins with 'a', of which no run of seed 8 in"));
}

TEST_F(Results, ATableWithoutItsRecordsIsNotReplaced) {
  Write("table.md", "mine");
  const CommandOutcome made = Make("10", {"--row", "a", "--write", In("table.md")});
  EXPECT_EQ(made.exit_code, kExitUsage) << made.text;
  EXPECT_THAT(made.text, HasSubstr("table.json' are not"));
  EXPECT_EQ(ReadTextFile(folder_ / "table.md").value(), "mine");
}

TEST_F(Results, ARowWhoseComparisonIsMissingKeepsItsOwnFigures) {
  Write("out/runs/a-7/whole", "\n");
  WriteReport(10, 0, "d");
  const CommandOutcome made = Make("10", {"--row", "d"});
  EXPECT_EQ(made.exit_code, kExitFailure) << made.text;
  EXPECT_THAT(made.text, HasSubstr("d, seed 7: compare with row 'a': "));
  EXPECT_THAT(made.text, HasSubstr("make that row first"));
  EXPECT_THAT(made.text, HasSubstr("| fourth `d` | - | - | runs of a | 100.0 ["));
  EXPECT_THAT(made.text, HasSubstr("| fourth | a | 7 | missing |"));
}

TEST_F(Results, ShowsRowsThatWereAskedForBesideThoseTheyAreComparedWith) {
  Write("out/runs/a-7/whole", "\n");
  WriteReport(10, 0);
  WriteReport(10, 0, "d");
  (void)Make("10", {"--row", "a", "--row", "d"});
  const CommandOutcome one = Make("10", {"--row", "a"});
  EXPECT_THAT(one.text, HasSubstr("| first `a` |"));
  EXPECT_THAT(one.text, Not(HasSubstr("| fourth")));
  EXPECT_THAT(ReadTextFile(folder_ / "out/results.md").value(), HasSubstr("| fourth `d` |")) << "the table keeps all";
  const CommandOutcome compared = Make("10", {"--row", "d"});
  EXPECT_THAT(compared.text, HasSubstr("| first `a` |"));
  EXPECT_THAT(compared.text, HasSubstr("| fourth `d` |"));
}

// with the folder of another --out, say
TEST_F(Results, AComparisonIsNotLostWhereTheOtherRowIsNotThere) {
  Write("out/runs/a-7/whole", "\n");
  WriteReport(10, 0);
  WriteReport(10, 0, "d");
  ASSERT_EQ(Make("10", {"--row", "a"}).exit_code, kExitOk);
  std::filesystem::remove_all(folder_ / "out/eval/a-7");
  const CommandOutcome missing = Make("10", {"--row", "d"});
  EXPECT_THAT(missing.text, HasSubstr("| fourth | a | 7 | missing |"));

  auto records = OrderedJson::parse(ReadTextFile(folder_ / "out/results.json").value());
  OrderedJson& comparison = records["rows"][1]["reports"][0]["report"]["comparison"];
  EXPECT_EQ(comparison["with"], "a");
  comparison = {{"overall", {{"n", 10}, {"both", 7}, {"only_first", 2}, {"only_second", 1}}},
                {"with", "a"},
                {"with_sha256", cli::RolloutsHash(records["rows"][0]["reports"][0]["report"])}};
  Write("out/results.json", records.dump());
  const CommandOutcome kept = Make("10", {"--row", "d"});
  EXPECT_THAT(kept.text, HasSubstr("make that row first")) << "it cannot be made again";
  EXPECT_THAT(kept.text, HasSubstr("| fourth | a | 7 | 10 | 2 | 1 | 10.0 ["));
}

// `d` beside it is compared itself, and said to be compared with nothing
TEST_F(Results, ARowThatIsComparedWithAComparedOneIsShownWithBoth) {
  Write("out/runs/a-7/whole", "\n");
  for (const char* row : {"a", "d", "e"}) WriteReport(10, 0, row);
  (void)Make("10", {"--row", "a", "--row", "d", "--row", "e"});  // reports without a spec: compared with nothing yet
  auto records = OrderedJson::parse(ReadTextFile(folder_ / "out/results.json").value());
  const std::string hash = cli::RolloutsHash(records["rows"][0]["reports"][0]["report"]);
  for (auto& row : records["rows"]) {
    if (row["row"] != "d") continue;
    row["reports"][0]["report"]["comparison"] = {
        {"overall", {{"n", 10}, {"both", 7}, {"only_first", 2}, {"only_second", 1}}},
        {"with", "a"},
        {"with_sha256", hash}};
  }
  Write("out/results.json", records.dump());
  const CommandOutcome made = Make("10", {"--row", "e"});
  EXPECT_THAT(made.text, HasSubstr("| first `a` |"));
  EXPECT_THAT(made.text, HasSubstr("| fourth | a | 7 | 10 | 2 | 1 | 10.0 ["));
}

// before, it was the last word after hours of training
TEST_F(Results, AnEvaluationThatCannotBeIsSaidBeforeTheCollection) {
  for (const auto& [eval, says] : {std::pair{"{tasks: [pik]}", "did you mean 'pick'?"},
                                   {"{scenes: none}", "campaign files are in"},
                                   {"{pushes: 20}", "rollout.pushes.count"},
                                   {"{set: [rolout.x=1]}", "did you mean 'rollout'?"}}) {
    Write("results.yaml", fmt::format("rows:\n  - name: a\n    title: first\n    data: {{campaign: none.yaml}}\n"
                                      "    train: {{minutes: 1}}\n    eval: {}\n",
                                      eval));
    const CommandOutcome made =
        RunEtude({"results", In("results.yaml"), "--out", In("out"), "--domain", "81"}, folder_ / "output.txt");
    EXPECT_EQ(made.exit_code, kExitUsage) << made.text;
    EXPECT_THAT(made.text, HasSubstr("a, seed 1: eval: "));
    EXPECT_THAT(made.text, HasSubstr(says));
    EXPECT_THAT(made.text, Not(HasSubstr("etude collect")));
    EXPECT_FALSE(std::filesystem::exists(folder_ / "out/rows/a.json"));
  }
}

TEST_F(Results, DoesNotTakeTheEvaluationOfARunThatWasTrainedAgain) {
  Write("out/runs/a-7/whole", "\n");
  Write("out/runs/a-7/checkpoints/latest.safetensors", "trained again");
  const OrderedJson all{{"n", 10}, {"success", {{"successes", 10}}}};
  Write("out/eval/a-7/eval.json",
        OrderedJson({{"policy", {{"sha256", std::string(64, '0')}}}, {"done", 10}, {"overall", all}}).dump());
  const CommandOutcome made = Make("10", {"--row", "a"});
  EXPECT_EQ(made.exit_code, kExitUsage) << made.text;
  EXPECT_THAT(made.text, HasSubstr("is of another checkpoint than"));
  EXPECT_THAT(made.text, Not(HasSubstr("eval-a-7: etude eval")));
  EXPECT_THAT(made.text, Not(HasSubstr("| first")));
}

TEST_F(Results, KeepsHowLongATrainingTook) {
  Write("out/runs/a-7/whole", "\n");
  Write("out/runs/a-7/metrics.jsonl", "{\"kind\":\"end\",\"elapsed_s\":594}\n");
  WriteReport(10, 0);
  const CommandOutcome made = Make("10", {"--row", "a"});
  ASSERT_EQ(made.exit_code, kExitOk) << made.text;
  EXPECT_THAT(made.text, HasSubstr("| first `a` | the campaign's | 10 min (took 9.9 min) | scratch | 100.0 ["));
}

// A row of two seeds whose programs are stand-ins: they note that they were called, and end well. The command itself is
// a copy beside them, for it starts the `etude` of its own folder.
class ResultsOfStandIns : public Results {
 protected:
  void SetUp() override {
    ASSERT_TRUE(MakeFolders(folder_ / "bin"));
    ASSERT_TRUE(std::filesystem::copy_file(ProgramsFolder() / "etude", folder_ / "bin/results"));
    WriteProgram(folder_ / "bin/etude", "#!/bin/sh\nexit 0\n");
    WriteProgram(folder_ / "bin/etude-trainer", "#!/bin/sh\nexit 0\n");
  }
  // @param episodes  that the row asks for
  CommandOutcome MakeTwoSeeds(int episodes) {
    Write("results.yaml", fmt::format("rows:\n  - name: a\n    title: first\n"
                                      "    data: {{campaign: none.yaml, episodes: {}}}\n"
                                      "    train: {{minutes: 1, seeds: [7, 8]}}\n    eval: {{episodes: 10}}\n",
                                      episodes));
    auto process = campaign::Process::Start(
        {{In("bin/results"), "results", In("results.yaml"), "--out", In("out"), "--domain", "81"},
         folder_ / "output.txt",
         {{"ETUDE_SHARE", std::filesystem::absolute("deploy").string()}}});
    if (!process) return {-1, process.error().message};
    const int exit_code = process->Wait(std::chrono::seconds(60)).value_or(-1);
    return {exit_code, ReadTextFile(folder_ / "output.txt").value_or("")};
  }
  // The first `count` episodes of the row's dataset.
  void WriteDataset(std::uint64_t count) {
    const CampaignSpec spec = SyntheticSpec();
    auto writer = store::DatasetWriter::Open(folder_ / "out/data/a", spec);
    ASSERT_TRUE(writer) << writer.error().message;
    for (std::uint64_t i = 0; i < count; ++i) ASSERT_TRUE(writer->Commit(MakeSyntheticEpisode(spec, i, 10)));
  }
};

// how often `what` is begun
int TimesOf(const std::string& what, const std::string& text) {
  int times = 0;
  for (auto at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++times;
  return times;
}

TEST_F(ResultsOfStandIns, ACollectionThatFailsIsTriedAgainAndNothingTrainsOnItsRest) {
  WriteProgram(folder_ / "bin/etude", "#!/bin/sh\nexit 3\n");
  WriteDataset(2);
  const CommandOutcome made = MakeTwoSeeds(2);
  EXPECT_EQ(made.exit_code, kExitMachine) << made.text;
  EXPECT_EQ(TimesOf("data-a: etude collect", made.text), 2) << made.text;
  for (const char* words : {"a, seed 7: data-a ended with 3", "a, seed 8: data-a ended with 3"})
    EXPECT_THAT(made.text, HasSubstr(words));
  EXPECT_THAT(made.text, Not(HasSubstr("train-a")));
}

TEST_F(ResultsOfStandIns, NothingIsCollectedForATrainingThatCannotBegin) {
  WriteProgram(folder_ / "bin/etude-trainer",
               "#!/bin/sh\nfor last; do :; done\n[ $last = --check ] && echo no such experiment && exit 2\n");
  WriteDataset(2);
  const CommandOutcome made = MakeTwoSeeds(2);
  EXPECT_EQ(made.exit_code, kExitUsage) << made.text;
  for (const char* words : {"a, seed 7: train: no such experiment", "a, seed 8: train: no such experiment"})
    EXPECT_THAT(made.text, HasSubstr(words));
  EXPECT_THAT(made.text, Not(HasSubstr("etude collect")));
}

// a collection that was stopped ends well
TEST_F(ResultsOfStandIns, NothingTrainsOnFewerDemonstrationsThanTheRowAsksFor) {
  WriteDataset(2);
  const CommandOutcome made = MakeTwoSeeds(3);
  EXPECT_EQ(made.exit_code, kExitFailure) << made.text;
  EXPECT_THAT(made.text, HasSubstr("has 2 of 3 demonstrations"));
  EXPECT_EQ(TimesOf("data-a: etude collect", made.text), 2) << made.text;
  EXPECT_THAT(made.text, Not(HasSubstr("train-a")));
}

TEST_F(ResultsOfStandIns, AWholeDatasetIsCollectedOnce) {
  WriteDataset(2);
  const CommandOutcome made = MakeTwoSeeds(2);
  EXPECT_EQ(TimesOf("data-a: etude collect", made.text), 1) << made.text;
  EXPECT_THAT(made.text, HasSubstr("train-a-7: etude train"));
  EXPECT_THAT(made.text, HasSubstr("train-a-8: etude train"));
}

// only from the root of the sources; a package has no such folder
TEST_F(Results, TheRowsThatComeAlongAreFoundFromAnywhere) {
  const auto said =
      RunInShell("cd '" + folder_.path().string() + "' && '" +
                 std::filesystem::absolute(ProgramsFolder() / "etude").string() + "' results --row nobodys 2>&1");
  EXPECT_EQ(said.code, kExitUsage) << said.text;
  EXPECT_THAT(said.text, HasSubstr("no such row"));
}

// a row of its own, of runs that are there: sentences are as many as their suite has
TEST_F(Results, EvaluatesTheRunsOfAnotherRow) {
  const CommandOutcome early = Make("10", {"--row", "c"});
  EXPECT_EQ(early.exit_code, kExitFailure) << early.text;
  EXPECT_THAT(early.text, HasSubstr("make that row first"));

  Write("out/runs/a-7/whole", "\n");
  Write("out/eval/c-7/eval.json", R"({"done": 7, "episodes": 8, "overall": {"n": 7}})");
  const CommandOutcome going_on = Make("10", {"--row", "c"});
  EXPECT_THAT(going_on.text, HasSubstr("--sentences table8 --scenes-each 2"));
  EXPECT_THAT(going_on.text, Not(HasSubstr("--episodes")));

  Write("out/eval/c-7/eval.json", R"({"done": 8, "episodes": 8, "overall": {"n": 8, "success": {"successes": 6}}})");
  const CommandOutcome whole = Make("10", {"--row", "c"});
  ASSERT_EQ(whole.exit_code, kExitOk) << whole.text;
  EXPECT_THAT(whole.text, HasSubstr("| third `c` | - | - | runs of a | 75.0 ["));
}

}  // namespace results_test
}  // namespace etude
