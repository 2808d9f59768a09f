// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/eval_report.cc
#include "services/campaign/eval_report.h"

#include <gmock/gmock.h>

namespace etude::campaign {
namespace eval_report_test {

Episode Rollout(std::uint64_t index, const std::string& task, bool success) {
  Episode episode;
  episode.index = index;
  episode.task = task;
  episode.success = success;
  episode.outcome = success ? "success" : "timeout";
  episode.details["success_latched"] = success;
  return episode;
}

TEST(RowOf, AveragesTheDecisionsInCentimetres) {
  Episode episode = Rollout(4, "pick", true);
  episode.details["decisions"] = {
      {{"step", 0}, {"checkpoint_step", 900}, {"touched", false}, {"error_m", {{"TAR3D", 0.01}, {"EE3D", 0.001}}}},
      {{"step", 15}, {"checkpoint_step", 950}, {"touched", true}, {"error_m", {{"TAR3D", 0.03}}}},
      {{"step", 30}, {"error_m", {{"TAR3D", "text"}, {"EE3D", nullptr}}}}};

  const RolloutRow row = RowOf(episode);

  EXPECT_EQ(row.decisions, 3);
  EXPECT_NEAR(row.error_cm.at("TAR3D"), 2.0, 1e-9);
  EXPECT_NEAR(row.error_cm.at("EE3D"), 0.1, 1e-9);
  EXPECT_NEAR(row.error_before_contact_cm.at("TAR3D"), 1.0, 1e-9);
  EXPECT_FALSE(row.error_cm.contains("DISP"));
}

TEST(RowOf, FindsTheFirstBadDecisionAndItsModule) {
  Episode episode = Rollout(4, "pick", false);
  const auto decide = [](int step, double target_m, double hand_m) {
    return OrderedJson{{"step", step}, {"error_m", {{"EE3D", hand_m}, {"TAR3D", target_m}}}};
  };
  episode.details["decisions"] = {decide(0, 0.019, 0.001), decide(15, 0.03, 0.001)};
  episode.details["decisions"].push_back(decide(30, 0.9, 0.9));
  const RolloutRow row = RowOf(episode);
  ASSERT_TRUE(row.first_bad);
  EXPECT_EQ(row.first_bad->module, "TAR3D");
  EXPECT_EQ(row.first_bad->decision, 1);
  EXPECT_EQ(row.first_bad->step, 15u);
  EXPECT_NEAR(row.first_bad->error_cm, 3, 1e-9);
  const OrderedJson json = RowJson(row);
  EXPECT_EQ(json["first_bad"]["module"], "TAR3D");
  EXPECT_EQ(json["first_bad"]["over_cm"], kBadDecision_cm);

  episode.details["decisions"] = {decide(0, 0.01, 0.002), decide(15, 0.03, 0.05)};
  EXPECT_EQ(RowOf(episode).first_bad->module, "EE3D") << "of two the one that was off most";
  episode.details["decisions"] = {decide(0, 0.01, 0.002), decide(15, 0.002, 0.001)};
  EXPECT_FALSE(RowOf(episode).first_bad);
  EXPECT_FALSE(RowJson(RowOf(episode)).contains("first_bad"));
}

TEST(RowOf, ReadsTheJudgement) {
  Episode episode = Rollout(4, "pick", false);
  episode.details["success_latched"] = true;
  episode.details["violations"] = {{{"kind", "torque"}, {"what", "elbow"}, {"step", 3}},
                                   {{"kind", "torque"}, {"what", "wrist"}, {"step", 9}},
                                   {{"kind", "self_contact"}, {"what", "forearm-hand"}, {"step", 9}}};
  episode.details["disturbed_objects"] = {"milk"};
  episode.details["latency_steps"] = 4;

  const RolloutRow row = RowOf(episode);

  EXPECT_FALSE(row.success);
  EXPECT_TRUE(row.success_latched);
  EXPECT_THAT(row.violations, testing::ElementsAre("self_contact", "torque"));
  EXPECT_THAT(row.disturbed, testing::ElementsAre("milk"));
  EXPECT_EQ(row.latency_steps, 4);
}

TEST(RowOf, SurvivesDetailsOfAnyShape) {
  for (const char* text : {"null", "3", "[]", "{}", R"({"decisions": 5})", R"({"decisions": [1, "a", [2]]})",
                           R"({"violations": 3, "disturbed_objects": {"a": [1]}, "latency_steps": -1})",
                           R"({"violations": [1, {"kind": 2}], "success_latched": "yes"})",
                           R"({"decisions": [{"error_m": 3}, {"error_m": {"TAR3D": 1e999}}]})"}) {
    Episode episode = Rollout(0, "pick", false);
    episode.details = OrderedJson::parse(text, nullptr, false);
    const RolloutRow row = RowOf(episode);
    EXPECT_TRUE(row.error_cm.empty()) << text;
    EXPECT_TRUE(row.violations.empty()) << text;
    EXPECT_FALSE(row.success_latched) << text;
  }
}

// Four rollouts: two strict successes, one that is latched only, one of neither.
class Report : public testing::Test {
 protected:
  Report() {
    spec_.episodes = 4;
    for (const auto& [index, task, success] :
         {std::tuple{0, "pick", true}, {1, "pick", true}, {2, "push", false}, {3, "push", false}})
      rows_[index] = RowOf(Rollout(index, task, success));
    rows_[2].success_latched = true;
    rows_[2].violations = {"torque"};
    rows_[3].disturbed = {"milk", "bread"};
    rows_[0].error_cm["TAR3D"] = 1;
    rows_[2].error_cm["TAR3D"] = 3;
    rows_[2].error_cm["EXTRA3D"] = 5;
    rows_[2].error_before_contact_cm["TAR3D"] = 2;
    rows_[3].latency_steps = 4;
  }
  CampaignSpec spec_;
  std::map<std::uint64_t, RolloutRow> rows_;
};

TEST_F(Report, GivesWilsonIntervalsOfBothCriteriaPerTaskAndOverall) {
  const OrderedJson report = EvalReport(spec_, rows_);

  EXPECT_EQ(report["done"], 4);
  const OrderedJson& pick = report["per_task"][0];
  EXPECT_EQ(pick["n"], 2);
  EXPECT_EQ(pick["success"]["share"], 1.0);
  EXPECT_NEAR(pick["success"]["low"].get<double>(), 0.342, 1e-3);  // Wilson, 2 of 2
  const OrderedJson& push = report["per_task"][1];
  EXPECT_EQ(push["success"]["successes"], 0);
  EXPECT_EQ(push["success_latched"]["successes"], 1);
  EXPECT_EQ(push["with_violations"], 1);
  EXPECT_EQ(push["violations"]["torque"], 1);
  EXPECT_EQ(push["with_others_moved"], 1);
  EXPECT_EQ(report["per_task"][2]["n"], 0) << "put_down has not come yet";
  EXPECT_EQ(report["overall"]["success"]["share"], 0.5);
  EXPECT_EQ(report["overall"]["success_latched"]["share"], 0.75);
  EXPECT_EQ(report["per_episode"].size(), 4u);
  EXPECT_EQ(report["per_episode"][2]["outcome"], "timeout");
  EXPECT_EQ(report["per_episode"][2]["violations"][0], "torque");
}

TEST_F(Report, ErrorsAreMeansOverRolloutsOfWhateverModulesThereAre) {
  const OrderedJson report = EvalReport(spec_, rows_);
  const OrderedJson& overall = report["overall"];
  EXPECT_NEAR(overall["error_cm"]["TAR3D"].get<double>(), 2.0, 1e-9);
  EXPECT_NEAR(overall["error_cm"]["EXTRA3D"].get<double>(), 5.0, 1e-9);
  EXPECT_EQ(overall["error_cm"].begin().key(), "TAR3D") << "the paper's come first";
  EXPECT_NEAR(overall["error_before_contact_cm"]["TAR3D"].get<double>(), 2.0, 1e-9);
}

TEST_F(Report, SaysTheLatencyThatWasSetAndThatWasFound) {
  const OrderedJson latency = EvalReport(spec_, rows_)["latency"];
  EXPECT_EQ(latency["setting_ms"], -1);
  EXPECT_EQ(latency["least_steps"], 0);
  EXPECT_EQ(latency["most_steps"], 4);
  EXPECT_FALSE(EvalReport(spec_, {})["latency"].contains("most_steps"));
}

TEST_F(Report, TableShowsBothCriteriaSideBySide) {
  const std::string table = EvalTable(EvalReport(spec_, rows_));
  EXPECT_THAT(table, testing::HasSubstr("50.0 [15.0, 85.0]")) << table;
  EXPECT_THAT(table, testing::HasSubstr("75.0 [30.1, 95.4]")) << table;
  EXPECT_THAT(table, testing::HasSubstr("2.00 (2.00)")) << table;
  EXPECT_THAT(table, testing::HasSubstr("5.00 (-)")) << table;
  EXPECT_THAT(table, testing::HasSubstr("only this column stands beside the paper's figures")) << table;
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 7) << "head, three tasks, overall, two lines of meaning";
}

}  // namespace eval_report_test
}  // namespace etude::campaign
