// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/results_table.cc and results_comparison.cc
#include "services/cli/results_table.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/cli/results_report.h"

namespace etude::cli {
namespace results_table_test {

using ::testing::HasSubstr;
using ::testing::Not;

OrderedJson Report(int n, int strict, int latched) {
  const auto entry = [&](const char* task) {
    return OrderedJson{
        {"task", task}, {"n", n}, {"success", {{"successes", strict}}}, {"success_latched", {{"successes", latched}}}};
  };
  return {{"overall", entry("overall")}, {"per_task", {entry("pick")}}};
}

ResultRow Row(double goal) {
  ResultRow row;
  row.name = "a";
  row.title = "UR5";
  row.paper = "82.4";
  row.goal = goal;
  row.data = {.campaign = "quickstart", .episodes = 600};
  row.train.minutes = 10;
  row.train.init = "base";
  row.train.add = {"obstacle"};
  row.train.like = {"OBST2D=TAR2D"};
  row.train.freeze = {"LANG", "image"};
  return row;
}

// the share and the interval of all rollouts
TEST(ResultsTable, HasBothCriteriaWithIntervalsAndEverySeed) {
  const ResultRow row = Row(95);
  const std::string table =
      ResultsTable({{&row, {{1, "then", Report(100, 90, 100)}, {2, "now", Report(100, 96, 98)}}}});

  EXPECT_THAT(table,
              HasSubstr("| UR5 `a` | 600 | 10 min | base + obstacle, like: OBST2D=TAR2D, frozen: LANG, image | 93.0 "
                        "[88.6, 95.8] | 90.0, 96.0 | "
                        "99.0 [96.4, 99.7] | 82.4 | 95 (missed) | - | nominal, seed 1 | now; then |"));
  EXPECT_THAT(table, HasSubstr("| UR5 | pick | 93.0 [88.6, 95.8] | 99.0 [96.4, 99.7] |"));
  const ResultRow easy = Row(90);
  EXPECT_THAT(ResultsTable({{&easy, {{1, "now", Report(100, 96, 98)}}}}), Not(HasSubstr("missed")));
}

TEST(ResultsTable, SaysNetworkScenesAndWhatThePaperHadBesideItsFigures) {
  ResultRow row = Row(0);
  row.train = {.config = "faithful", .steps = 1};
  row.eval.scenes = "robust";
  row.eval.seed = 9019;
  OrderedJson first = Report(10, 9, 9), second = first;
  first["scenes"]["first_draw"] = 0.5;
  second["scenes"]["first_draw"] = 0.7;
  const std::string table = ResultsTable({{&row, {{1, "now", first}, {2, "now", second}}}});
  EXPECT_THAT(table, HasSubstr("| faithful | robust, seed 9019, 60 % first draws | now |"));
  EXPECT_THAT(table, HasSubstr("Beside the paper's figures"));
}

TEST(ResultsTable, NamesThePolicyThatWasTrainedAndWhatItWasTold) {
  ResultRow base = Row(0);
  base.train = {.minutes = 10, .set = {"policy=compact/relational", "data.strange=0.4"}};
  const auto table = [](const ResultRow& row) { return ResultsTable({{&row, {{1, "now", Report(10, 9, 9)}}}}); };
  EXPECT_THAT(table(base), HasSubstr("| compact/relational, data.strange=0.4 | nominal, seed 1"));

  ResultRow on_top = Row(0), further = Row(0), evaluated = Row(0);
  on_top.train.set = {"optimizer.lr=0.001"};
  on_top.train.fresh = {"joints"};
  on_top.begins_with = DefinitionOf(base);
  EXPECT_THAT(table(on_top), HasSubstr("| base + obstacle, anew: joints, like: OBST2D=TAR2D, frozen: LANG, image |"));
  EXPECT_THAT(table(on_top), HasSubstr("| compact/relational, optimizer.lr=0.001 | nominal, seed 1"));
  further.begins_with = DefinitionOf(on_top);
  EXPECT_THAT(table(further), HasSubstr("| compact/relational | nominal, seed 1")) << "of the first of them";
  evaluated.data = {};
  evaluated.train = {.runs_of = "on_top"};
  evaluated.begins_with = DefinitionOf(on_top);
  EXPECT_THAT(table(evaluated), HasSubstr("| compact/relational, optimizer.lr=0.001 | nominal, seed 1"));
}

// As records keep it. @param other  the report of the row `with`
OrderedJson ComparisonWith(const std::string& with, const OrderedJson& other, int both, int first, int second, int n) {
  return {{"overall", {{"n", n}, {"both", both}, {"only_first", first}, {"only_second", second}}},
          {"with", with},
          {"with_sha256", RolloutsHash(other)}};
}

// A row that is compared with another one, and that one's three seeds, which are in the table, too.
struct ComparedRows {
  ResultRow row = Row(0), scratch = Row(0);
  OrderedJson there = Report(200, 159, 159);
  std::vector<ResultReport> of_scratch{{1, "now", there}, {2, "now", there}, {3, "now", there}};

  ComparedRows() {
    row.compare = scratch.name = "scratch";
    scratch.title = "from scratch";
  }
  std::string Table(const std::vector<OrderedJson>& reports) const {
    ResultLine line{&row, {}};
    for (const auto& report : reports) line.reports.push_back({line.reports.size() + 1, "now", report});
    return ResultsTable({{&scratch, of_scratch}, line});
  }
};

TEST(ResultsTable, SaysWhereARowIsComparedWithAnotherWhetherItCanBeChance) {
  const ComparedRows rows;
  OrderedJson report = Report(10, 9, 9);
  EXPECT_THAT(rows.Table({report}), Not(HasSubstr("McNemar")));
  report["comparison"] = ComparisonWith("scratch", rows.there, 150, 31, 9, 200);
  const std::string one = rows.Table({report});
  EXPECT_THAT(one, HasSubstr("| UR5 | scratch | 1 | 200 | 31 | 9 | 11.0 [4.9, 17.2] | 0.00068 |"));
  EXPECT_THAT(one, Not(HasSubstr("| scratch | all |")));

  OrderedJson second = report, missing = report;
  second["comparison"] = ComparisonWith("scratch", rows.there, 150, 9, 31, 200);
  missing["comparison"] = {{"missing", "compare with row 'scratch': not there"}, {"with", "scratch"}};
  const std::string all = rows.Table({report, second});
  EXPECT_THAT(all, HasSubstr("| UR5 | scratch | 2 | 200 | 9 | 31 | -11.0 [-17.2, -4.9] | 0.00068 |"));
  EXPECT_THAT(all, HasSubstr("| UR5 | scratch | all | 400 | 40 | 40 | 0.0 | - |")) << "the same scenes twice";
  const std::string some = rows.Table({report, second, missing});
  EXPECT_THAT(some, HasSubstr("| UR5 | scratch | 3 | missing | | | | |"));
  EXPECT_THAT(some, Not(HasSubstr("| scratch | all |"))) << "not all of them";
}

// else the numbers of one row would stand under the name of another
TEST(ResultsTable, AComparisonIsWithTheRowThatIsNamedAsItIsInTheTable) {
  ComparedRows rows;
  rows.row.goals = {{"drop", 1.1}};
  OrderedJson report = Report(10, 9, 9);
  report["comparison"] = ComparisonWith("scratch", rows.there, 150, 31, 9, 200);
  const auto missing = testing::AllOf(HasSubstr("| 1 | missing | | | | |"), HasSubstr("| - | not measured |"));
  EXPECT_THAT(rows.Table({report}), Not(HasSubstr("missing")));

  rows.row.compare = "other";
  rows.scratch.name = "other";
  EXPECT_THAT(rows.Table({report}), missing);
  rows.row.compare = rows.scratch.name = "scratch";
  rows.of_scratch[0].report["overall"]["success"]["successes"] = 160;
  EXPECT_THAT(rows.Table({report}), missing) << "that row was made again";
  rows.of_scratch.erase(rows.of_scratch.begin());
  EXPECT_THAT(rows.Table({report}), missing) << "of seed 1 it is not in the table";
  report["comparison"].erase("with_sha256");
  EXPECT_THAT(rows.Table({report}), missing) << "an earlier version's does not say";

  rows.row.compare.clear();
  rows.row.goals.clear();
  EXPECT_THAT(rows.Table({report}), Not(HasSubstr("McNemar"))) << "not compared any more";
}

TEST(ResultsTable, SaysWhatTrainedAndHowLongWhereThatIsKnown) {
  ResultRow row = Row(0);
  row.train = {.steps = 1900};
  const ResultReport known{
      .seed = 1, .made = "now", .report = Report(10, 9, 9), .training_s = 276, .train = 80, .valid = 20};
  const ResultReport old{.seed = 2, .made = "now", .report = Report(10, 9, 9)};
  EXPECT_THAT(ResultsTable({{&row, {known, old}}}),
              HasSubstr("| UR5 `a` | 80 + 20 validation | 1900 steps (took 4.6 min) |"));
  EXPECT_THAT(ResultsTable({{&row, {old}}}), HasSubstr("| UR5 `a` | 600 | 1900 steps |"));
}

TEST(ResultsTable, HasTheMeanErrorOfEachModuleOverTheSeeds) {
  const ResultRow row = Row(0);
  OrderedJson first = Report(10, 9, 9), second = first;
  first["overall"]["error_cm"] = {{"TAR3D", 0.2}, {"DISP", 0.5}};
  first["overall"]["error_before_contact_cm"] = {{"TAR3D", 0.1}};
  second["overall"]["error_cm"] = {{"TAR3D", 0.4}, {"DISP", "odd"}};
  const std::string table = ResultsTable({{&row, {{1, "now", first}, {2, "now", second}}}});
  EXPECT_THAT(table, HasSubstr("| UR5 | TAR3D | 0.30 | 0.10 |\n| UR5 | DISP | 0.50 | - |"));
}

TEST(ResultsTable, HoldsEveryGoalAgainstWhatWasMeasured) {
  ResultRow row = Row(0);
  row.compare = "seen";
  row.goals = {{"latched", 95}, {"drop", 1.1}, {"minutes", 5}, {"TAR3D", 0.3}, {"DISP", 0.2}, {"EE3D", 0.05}};
  ResultReport first{.seed = 1, .made = "now", .report = Report(100, 90, 96), .training_s = 276};
  first.report["overall"]["error_cm"] = {{"TAR3D", 0.2}, {"DISP", 0.5}};
  first.report["overall"]["error_before_contact_cm"] = {{"TAR3D", 0.1}};
  ResultRow seen = Row(0);
  seen.name = "seen";
  const OrderedJson there = Report(100, 91, 96);
  first.report["comparison"] = ComparisonWith("seen", there, 88, 2, 3, 100);
  ResultReport second = first;
  second.seed = 2;
  second.training_s = 306;
  second.report["overall"]["error_cm"]["TAR3D"] = 0.4;

  const auto table = [&](const std::vector<ResultReport>& reports) {
    return ResultsTable({{&seen, {{1, "now", there}, {2, "now", there}}}, {&row, reports}});
  };
  const std::string one = table({first});
  EXPECT_THAT(one, HasSubstr("| UR5 | latched at least 95 % | 96.0 [90.2, 98.4] | yes |"));
  EXPECT_THAT(one, HasSubstr("| UR5 | at most 1.1 points below seen | 1.0 ["));
  EXPECT_THAT(one, HasSubstr("| UR5 | training at most 5 min | 4.6 | yes |"));
  EXPECT_THAT(one, HasSubstr("| UR5 | TAR3D at most 0.3 cm | 0.20 (before contact 0.10) | yes |"));
  EXPECT_THAT(one, HasSubstr("| UR5 | DISP at most 0.2 cm | 0.50 (before contact -) | missed |"));
  EXPECT_THAT(one, HasSubstr("| UR5 | EE3D at most 0.05 cm | - | not measured |"));
  const std::string two = table({first, second});
  EXPECT_THAT(two, HasSubstr("| UR5 | training at most 5 min | 5.1 | missed |")) << "each of them";
  EXPECT_THAT(two, HasSubstr("| UR5 | TAR3D at most 0.3 cm | 0.30 (before contact 0.10) | yes |")) << "the mean";
  EXPECT_THAT(two, HasSubstr("| UR5 | at most 1.1 points below seen | 1.0 | yes |")) << "the same scenes twice";
  second.report.erase("comparison");
  EXPECT_THAT(table({first, second}), HasSubstr("points below seen | - | not measured |")) << "each of them";

  row.goals = {{"drop", 0.9}, {"latched", 96.1}};
  EXPECT_THAT(table({first}), HasSubstr("points below seen | 1.0 [-4.5, 6.7] | missed |"));
  EXPECT_THAT(table({first}), HasSubstr("| latched at least 96.1 % | 96.0 [90.2, 98.4] | missed |"));
  const std::string old = table({{1, "now", OrderedJson::object()}});
  EXPECT_THAT(old, HasSubstr("| UR5 | latched at least 96.1 % | - | not measured |"));
  EXPECT_THAT(old, HasSubstr("| UR5 | at most 0.9 points below seen | - | not measured |"));
}

TEST(ResultsTable, BetterIsWhatIsNotByChance) {
  ComparedRows rows;
  rows.row.goals = {{"p", 0.05}};
  const auto table = [&](int both, int only_here, int only_there) {
    OrderedJson report = Report(200, 190, 190);
    report["comparison"] = ComparisonWith("scratch", rows.there, both, only_here, only_there, 200);
    return rows.Table({report});
  };
  EXPECT_THAT(table(150, 10, 1),
              HasSubstr("| UR5 | better than scratch, p below 0.05 | +4.5 points, p = 0.012 | yes |"));
  EXPECT_THAT(table(150, 1, 10), HasSubstr("| -4.5 points, p = 0.012 | missed |")) << "the other one is";
  EXPECT_THAT(table(150, 5, 1), HasSubstr("| +2.0 points, p = 0.22 | missed |"));
  EXPECT_THAT(rows.Table({Report(200, 190, 190)}), HasSubstr("p below 0.05 | - | not measured |"));
}

TEST(ResultsTable, LeavesOutWhatWasNotMeasuredAndSurvivesOddReports) {
  const ResultRow row = Row(0);
  EXPECT_THAT(ResultsTable({{&row, {}}}), Not(HasSubstr("UR5")));
  const std::string odd = ResultsTable({{&row, {{1, "now", OrderedJson::object()}}}});
  EXPECT_THAT(odd,
              HasSubstr("| UR5 `a` | 600 | 10 min | base + obstacle, like: OBST2D=TAR2D, frozen: LANG, image | - |"));
}

// 9 of 10 and 50 of 100: the mean of the two shares, 70 %, would lie outside the interval of the 110 rollouts.
TEST(ResultsTable, RolloutsCountAlikeSoThatTheShareLiesInItsInterval) {
  ResultRow row = Row(0);
  row.train = {.steps = 4000, .seeds = {1, 2}};
  row.paper.clear();
  const std::string table = ResultsTable({{&row, {{1, "now", Report(10, 9, 10)}, {2, "now", Report(100, 50, 100)}}}});
  EXPECT_THAT(table, HasSubstr("| UR5 `a` | 600 | 4000 steps | scratch | 53.6 [44.4, 62.7] | 90.0, 50.0 |"));
  EXPECT_THAT(table, HasSubstr("| 100.0 [96.6, 100.0] | - |  | compact | nominal, seed 1 | now |\n"));
}

// 94, 95 and 96 % are 95 % together, which sums of binary fractions miss by the last digit
TEST(ResultsTable, AGoalThatIsReachedIsNotMissedByRounding) {
  const ResultRow row = Row(95);
  const auto table = [&](int third) {
    return ResultsTable(
        {{&row,
          {{1, "now", Report(100, 94, 99)}, {2, "now", Report(100, 95, 99)}, {3, "now", Report(100, third, 99)}}}});
  };
  EXPECT_THAT(table(96), Not(HasSubstr("missed")));
  EXPECT_THAT(table(95), HasSubstr("95 (missed)"));
}

TEST(ResultsTable, NumbersThatAreNoneAreNotCounted) {
  const ResultRow row = Row(0);
  std::vector<OrderedJson> odd(5, Report(10, 5, 5));
  odd[0]["overall"]["n"] = "ten";
  odd[1]["overall"]["n"] = -10;
  odd[2]["overall"]["success"] = 5;
  odd[3]["overall"]["success"]["successes"] = 11;
  odd[4]["per_task"][0]["task"] = 3;
  odd[4]["overall"]["success"]["successes"] = nullptr;
  for (const auto& report : odd) {
    const std::string table = ResultsTable({{&row, {{1, "now", report}}}});
    EXPECT_THAT(table, HasSubstr("| base + obstacle, like: OBST2D=TAR2D, frozen: LANG, image | - |  |"))
        << report.dump();
  }
}

TEST(ResultsTable, SaysWhereTheNumberOfDemonstrationsIsTheCampaigns) {
  ResultRow row = Row(0);
  row.data.episodes = 0;
  EXPECT_THAT(ResultsTable({{&row, {{1, "now", Report(10, 9, 9)}}}}),
              HasSubstr("| UR5 `a` | the campaign's | 10 min |"));
}

TEST(ResultsTable, TasksStandInTheOrderInWhichTheyWereMeasured) {
  const ResultRow row = Row(0);
  OrderedJson both = Report(10, 5, 5);
  both["per_task"].push_back(both["per_task"][0]);
  both["per_task"][1]["task"] = "lift_up";
  both["per_task"].push_back(3);  // of another version
  const std::string table = ResultsTable({{&row, {{1, "now", Report(10, 9, 9)}, {2, "now", both}}}});
  const auto pick = table.find("| UR5 | pick | 70.0 ["), lift = table.find("| UR5 | lift_up | 50.0 [");
  ASSERT_NE(pick, std::string::npos) << table;
  ASSERT_NE(lift, std::string::npos) << table;
  EXPECT_LT(pick, lift);
}

TEST(ResultsTable, ACriterionThatAReportLacksIsNotCounted) {
  const ResultRow row = Row(50);
  OrderedJson old = Report(10, 6, 8);
  old["overall"].erase("success_latched");
  const std::string table = ResultsTable({{&row, {{1, "now", old}, {2, "now", Report(10, 8, 10)}}}});
  EXPECT_THAT(table, HasSubstr("| 70.0 [48.1, 85.5] | 60.0, 80.0 | 100.0 [72.2, 100.0] |"));
  EXPECT_THAT(table, HasSubstr("| 82.4 | 50 |"));
}

}  // namespace results_table_test
}  // namespace etude::cli
