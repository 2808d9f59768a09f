// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/eval_comparison.cc
#include "services/campaign/eval_comparison.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "services/campaign/eval_report.h"
#include "services/core/file.h"
#include "services/core/rng.h"
#include "services/spec/content_version.h"
#include "services/spec/task_name.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace eval_comparison_test {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// "1" a success, "l" latched only, "0" neither, "-" not there; tasks take turns.
OrderedJson ReportOf(const std::string& outcomes, const std::string& run = "a") {
  CampaignSpec spec;
  spec.tasks = {"pick", "push"};
  spec.rollout.run = run;
  std::map<std::uint64_t, RolloutRow> rows;
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    if (outcomes[i] == '-') continue;
    RolloutRow row;
    row.index = i;
    row.seed = 100 + i;
    row.task = spec.tasks[i % 2];
    row.target = "coke";
    row.success = outcomes[i] == '1';
    row.success_latched = outcomes[i] != '0';
    rows[i] = row;
  }
  return EvalReport(spec, rows);
}

std::vector<std::uint64_t> Counts(const OrderedJson& row) {
  std::vector<std::uint64_t> counts;
  for (const char* key : {"n", "both", "only_first", "only_second", "neither"})
    counts.push_back(row[key].get<std::uint64_t>());
  return counts;
}

TEST(EvalRules, NameTheTasksFilesAndTheVersions) {
  const OrderedJson rules = ReportOf("10")["rules"];
  EXPECT_EQ(rules["tasks"].size(), 2u);
  EXPECT_EQ(rules["tasks"]["pick"], ParseTask("pick")->spec->sha256);
  EXPECT_EQ(rules["content"], kContentVersion);
  EXPECT_EQ(rules["rollout"], kRolloutVersion);
}

// the same name, another criterion: their difference says nothing of the policies
TEST(CompareEvaluations, RefusesThoseThatWereJudgedByOtherRules) {
  const TemporaryFolder folder;
  OrderedJson other = ReportOf("1100");
  ASSERT_THAT(WriteFileAtomically(folder / "a/eval.json", ReportOf("1000").dump()), IsOk());
  ASSERT_THAT(WriteFileAtomically(folder / "b/eval.json", other.dump()), IsOk());
  EXPECT_THAT(CompareEvaluations(folder / "a", folder / "b"), IsOk());
  other["rules"]["tasks"]["push"] = "another file";
  ASSERT_THAT(WriteFileAtomically(folder / "b/eval.json", other.dump()), IsOk());
  EXPECT_THAT(CompareEvaluations(folder / "a", folder / "b"), MessageHas(R"(tasks.push ("another file", now ")"))
      << "as with scenes: the other's, and this one's";
  other.erase("rules");
  ASSERT_THAT(WriteFileAtomically(folder / "b/eval.json", other.dump()), IsOk());
  EXPECT_THAT(CompareEvaluations(folder / "a", folder / "b"), IsOk()) << "of an earlier version, which does not say";
}

TEST(CompareReports, CountsPairsPerTaskAndOverall) {
  const auto comparison = CompareReports(ReportOf("1111100l", "a"), ReportOf("1000011l", "b"));
  ASSERT_THAT(comparison, IsOk());
  EXPECT_EQ((*comparison)["first"], "a");
  EXPECT_EQ((*comparison)["second"], "b");
  EXPECT_THAT(Counts((*comparison)["overall"]), ElementsAre(8, 1, 4, 2, 1));
  EXPECT_THAT(Counts((*comparison)["per_task"][0]), ElementsAre(4, 1, 2, 1, 0)) << "pick: 0, 2, 4, 6";
  EXPECT_THAT(Counts((*comparison)["per_task"][1]), ElementsAre(4, 0, 2, 1, 1)) << "push: 1, 3, 5, 7";
  EXPECT_THAT(Counts((*comparison)["overall_latched"]), ElementsAre(8, 2, 4, 2, 0));
  EXPECT_DOUBLE_EQ((*comparison)["overall"]["share_first"].get<double>(), 5.0 / 8);
  // 4 against 2: (1 + 6 + 15) of 64 on each side
  EXPECT_DOUBLE_EQ((*comparison)["overall"]["p"].get<double>(), 2 * 22.0 / 64);
  EXPECT_EQ((*comparison)["unpaired"], 0);
}

TEST(CompareReports, LeavesOutWhatOnlyOneHas) {
  const auto comparison = CompareReports(ReportOf("1-110"), ReportOf("10-1011"));
  ASSERT_THAT(comparison, IsOk());
  EXPECT_EQ((*comparison)["n"], 3) << "0, 3 and 4";
  EXPECT_EQ((*comparison)["unpaired"], 4);
  EXPECT_THAT(Counts((*comparison)["overall"]), ElementsAre(3, 2, 0, 0, 1));
  EXPECT_THAT(ComparisonText(*comparison), HasSubstr("left out: 4 rollouts that only one of the two has"));
}

// Every count again, pair by pair, and p as the tail of a binomial from factorials.
TEST(CompareReports, CountsWhatAnybodyCounts) {
  Rng rng(4);
  for (int round = 0; round < 30; ++round) {
    std::string first, second;
    for (int i = 0; i < 24; ++i) first += "10l-"[rng.Below(4)], second += "10l-"[rng.Below(4)];
    const auto comparison = CompareReports(ReportOf(first, "a"), ReportOf(second, "b"));
    ASSERT_THAT(comparison, IsOk());
    for (const int task : {-1, 0, 1}) {  // all, pick, push
      std::vector<std::uint64_t> counts(5);
      for (std::size_t i = 0; i < first.size(); ++i) {
        if (first[i] == '-' || second[i] == '-' || (task >= 0 && static_cast<int>(i % 2) != task)) continue;
        ++counts[0];
        ++counts[first[i] == '1' ? (second[i] == '1' ? 1 : 2) : (second[i] == '1' ? 3 : 4)];
      }
      const OrderedJson& row = task < 0 ? (*comparison)["overall"] : (*comparison)["per_task"][task];
      EXPECT_EQ(Counts(row), counts) << first << " " << second;
      const double n = static_cast<double>(counts[2] + counts[3]);
      double tail = 0;
      for (double k = 0; k <= static_cast<double>(std::min(counts[2], counts[3])); ++k)
        tail += std::tgamma(n + 1) / std::tgamma(k + 1) / std::tgamma(n - k + 1) / std::exp2(n);
      EXPECT_NEAR(row["p"].get<double>(), std::min(1.0, 2 * tail), 1e-9);
    }
  }
}

// Binomials by hand: of n coins, so many ways of at most k on one side, twice, over 2^n.
TEST(CompareReports, ItsPAreThoseOfTheTables) {
  for (const auto& [only_first, only_second, p] : {std::tuple{1, 0, 1.0},
                                                   {5, 0, 2 * 1.0 / 32},
                                                   {0, 6, 2 * 1.0 / 64},
                                                   {9, 1, 2 * (1.0 + 10) / 1024},
                                                   {2, 10, 2 * (1.0 + 12 + 66) / 4096},
                                                   {3, 12, 2 * (1.0 + 15 + 105 + 455) / 32768}}) {
    // what both or neither can do is no evidence
    const std::string first = std::string(only_first, '1') + std::string(only_second, '0') + "1100";
    const std::string second = std::string(only_first, '0') + std::string(only_second, '1') + "1100";
    const auto comparison = CompareReports(ReportOf(first), ReportOf(second)).value();
    EXPECT_DOUBLE_EQ(comparison["overall"]["p"].get<double>(), p) << only_first << " " << only_second;
  }
}

TEST(CompareReports, TheOtherWayRoundIsTheSameEvidence) {
  const auto report = ReportOf("1110l01101", "a"), other = ReportOf("0100110l00", "b");
  const auto there = CompareReports(report, other).value(), back = CompareReports(other, report).value();
  for (const char* key : {"overall", "overall_latched"}) {
    EXPECT_EQ(there[key]["only_first"], back[key]["only_second"]);
    EXPECT_EQ(there[key]["only_second"], back[key]["only_first"]);
    EXPECT_EQ(there[key]["share_first"], back[key]["share_second"]);
    EXPECT_EQ(there[key]["both"], back[key]["both"]);
    EXPECT_EQ(there[key]["p"], back[key]["p"]);
  }
}

TEST(CompareReports, WithNothingInCommonHasNoEvidence) {
  const auto comparison = CompareReports(ReportOf("11--"), ReportOf("--11"));
  ASSERT_THAT(comparison, IsOk());
  EXPECT_EQ((*comparison)["n"], 0);
  EXPECT_EQ((*comparison)["unpaired"], 4);
  EXPECT_TRUE((*comparison)["per_task"].empty());
  EXPECT_EQ((*comparison)["overall"]["p"], 1.0);
  EXPECT_EQ((*comparison)["overall"]["share_first"], 0.0);
  EXPECT_THAT(ComparisonText(*comparison), HasSubstr("left out: 4 rollouts"));
}

TEST(CompareReports, RefusesRolloutsThatAreNotOfOneScene) {
  const OrderedJson report = ReportOf("11");
  for (const char* key : {"seed", "task", "target"}) {
    OrderedJson other = report;
    other["per_episode"][1][key] = key == std::string("seed") ? OrderedJson(7u) : OrderedJson("other");
    const auto comparison = CompareReports(report, other);
    EXPECT_THAT(comparison, HasCode(Code::kInvalidArgument)) << key;
    EXPECT_THAT(comparison, MessageHas("rollout 1 is 'push coke' of seed 101"));
  }
}

TEST(CompareReports, RefusesWhatIsNoReport) {
  for (const char* text : {"3", "{}", R"({"per_episode": 3})", R"({"per_episode": [3]})",
                           R"({"per_episode": [{"index": 0, "seed": 1, "task": "pick"}]})"})
    EXPECT_THAT(CompareReports(ReportOf("1"), OrderedJson::parse(text)), HasCode(Code::kCorrupt)) << text;
}

TEST(CompareReports, AsATable) {
  const auto comparison = CompareReports(ReportOf("1111100l", "a"), ReportOf("1000011l", "b"));
  const std::string text = ComparisonText(*comparison);
  EXPECT_THAT(text, HasSubstr("first: a   second: b\n"));
  EXPECT_THAT(text,
              HasSubstr("overall                8      1          4           2        1     62.5     37.5     0.6875"))
      << text;
  EXPECT_THAT(text, testing::Not(HasSubstr("left out")));
}

TEST(SceneDifferences, AreWhatMakesOtherScenesAndNothingElse) {
  CampaignSpec spec, other;
  other.name = "other";
  other.episodes = 7;
  other.image_stride = 2;
  other.max_attempts = 2;
  other.split.train = 0.3;
  other.stall_timeout_s = 9;
  other.determinism = "none";
  other.renderer = "gpu";
  other.device = 1;
  other.camera.width = other.camera.height = 96;
  other.rollout.run = "b";
  other.rollout.occlude = 0.2;
  other.rollout.pushes.count = 1;
  EXPECT_THAT(SceneDifferences(spec, other), IsEmpty()) << "who drives, and how hard it is, may differ";
  other.seed = 2;
  other.world.friction = 0.5;
  other.camera.fovy_deg = 40;
  other.rollout.sentences = {{"fetch it", "pick", "coke", ""}};
  const auto differences = SceneDifferences(spec, other);
  ASSERT_EQ(differences.size(), 4u) << testing::PrintToString(differences);
  EXPECT_EQ(differences[0], "seed (1, now 2)");
  EXPECT_EQ(differences[1], "camera.fovy_deg (60.0, now 40.0)");
}

TEST(RuleDifferences, AreOfTheRulesAloneAndNoneWhereAReportDoesNotSay) {
  const OrderedJson report{{"rules", {{"tasks", {{"pick", "a"}, {"push", "b"}}}, {"content", 7}, {"rollout", 4}}}};
  OrderedJson other = report;
  other["run"] = "another";
  EXPECT_THAT(RuleDifferences(report, other), IsEmpty());
  other["rules"]["tasks"]["push"] = "c";
  other["rules"]["rollout"] = 5;
  EXPECT_THAT(RuleDifferences(report, other), ElementsAre(R"(tasks.push ("b", now "c"))", "rollout (4, now 5)"));
  EXPECT_THAT(CheckSameRules(report, other, "b"), MessageHas("rollout (5, now 4)"));
  EXPECT_THAT(RuleDifferences(report, OrderedJson::object()), IsEmpty());
  EXPECT_THAT(RuleDifferences(OrderedJson::object(), report), IsEmpty());
}

class Folders : public testing::Test {
 protected:
  void Write(const std::string& name, const CampaignSpec& spec, const std::string& outcomes) {
    ASSERT_THAT(store::DatasetWriter::Open(folder_ / name / "rollouts", spec), IsOk());
    OrderedJson report = ReportOf(outcomes, name);
    report["spec"] = ToJson(spec);
    ASSERT_THAT(WriteFileAtomically(folder_ / name / "eval.json", report.dump()), IsOk());
  }
  TemporaryFolder folder_;
};

TEST_F(Folders, OfTheSameScenesAreCompared) {
  CampaignSpec spec;
  Write("a", spec, "10");
  spec.rollout.occlude = 0.5;
  Write("b", spec, "00");
  const auto comparison = CompareEvaluations(folder_ / "a", folder_ / "b");
  ASSERT_THAT(comparison, IsOk());
  EXPECT_THAT(Counts((*comparison)["overall"]), ElementsAre(2, 0, 1, 0, 1));
}

TEST_F(Folders, NeedTheirReportsAlone) {
  CampaignSpec spec;
  Write("a", spec, "10");
  Write("b", spec, "00");
  for (const char* name : {"a", "b"}) std::filesystem::remove_all(folder_ / name / "rollouts");
  ASSERT_THAT(CompareEvaluations(folder_ / "a", folder_ / "b"), IsOk());
  spec.seed = 9;
  Write("c", spec, "00");
  std::filesystem::remove_all(folder_ / "c" / "rollouts");
  EXPECT_THAT(CompareEvaluations(folder_ / "a", folder_ / "c"), MessageHas("seed (9, now 1)"));
}

TEST_F(Folders, OfReportsWithoutTheirSpecAreComparedByTheirRollouts) {
  CampaignSpec spec;
  for (const char* name : {"a", "b", "c"}) {
    if (std::string(name) == "c") spec.seed = 9;
    Write(name, spec, "10");
    OrderedJson report = ReportOf("10", name);
    ASSERT_EQ(report.erase("spec"), 1u);
    ASSERT_THAT(WriteFileAtomically(folder_ / name / "eval.json", report.dump()), IsOk());
  }
  ASSERT_THAT(CompareEvaluations(folder_ / "a", folder_ / "b"), IsOk());
  EXPECT_THAT(CompareEvaluations(folder_ / "a", folder_ / "c"), MessageHas("seed (9, now 1)"));
}

TEST_F(Folders, OfOtherScenesAreRefused) {
  CampaignSpec spec;
  Write("a", spec, "10");
  spec.seed = 9;
  spec.objects.pop_back();
  Write("b", spec, "10");
  const auto comparison = CompareEvaluations(folder_ / "a", folder_ / "b");
  EXPECT_THAT(comparison, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(comparison, MessageHas("seed (9, now 1)"));
  EXPECT_THAT(comparison, MessageHas("objects"));
}

TEST_F(Folders, ThatAreNoEvaluationsAreNamed) {
  Write("a", CampaignSpec(), "1");
  EXPECT_THAT(CompareEvaluations(folder_ / "a", folder_ / "none"), MessageHas("none' is no evaluation"));
  Write("b", CampaignSpec(), "1");
  std::filesystem::remove(folder_ / "b" / "eval.json");
  EXPECT_THAT(CompareEvaluations(folder_ / "a", folder_ / "b"), MessageHas("b' is no evaluation"));
}

}  // namespace eval_comparison_test
}  // namespace etude::campaign
