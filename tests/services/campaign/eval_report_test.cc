// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/eval_report.cc
#include "services/campaign/eval_report.h"

#include <gtest/gtest.h>

namespace etude::campaign {
namespace {

Episode Rollout(std::uint64_t index, const std::string& task, bool success) {
  Episode episode;
  episode.index = index;
  episode.task = task;
  episode.success = success;
  episode.outcome = success ? "success" : "timeout";
  return episode;
}

TEST(RowOf, AveragesTheDecisionsInCentimetres) {
  Episode episode = Rollout(4, "pick", true);
  episode.details["decisions"] = {
      {{"step", 0}, {"checkpoint_step", 900}, {"touched", false}, {"TAR3D", 0.01}, {"EE3D", 0.001}},
      {{"step", 15}, {"checkpoint_step", 950}, {"touched", true}, {"TAR3D", 0.03}},
      {{"step", 30}, {"TAR3D", "text"}, {"EE3D", nullptr}}};

  const RolloutRow row = RowOf(episode);

  EXPECT_EQ(row.decisions, 3);
  EXPECT_NEAR(row.error_cm.at("TAR3D"), 2.0, 1e-9);
  EXPECT_NEAR(row.error_cm.at("EE3D"), 0.1, 1e-9);
  EXPECT_NEAR(row.error_before_contact_cm.at("TAR3D"), 1.0, 1e-9);
  EXPECT_FALSE(row.error_cm.contains("DISP"));
}

TEST(RowOf, SurvivesDetailsOfAnyShape) {
  for (const char* text : {"null", "3", "[]", "{}", R"({"decisions": 5})", R"({"decisions": [1, "a", [2]]})"}) {
    Episode episode = Rollout(0, "pick", false);
    episode.details = OrderedJson::parse(text);
    EXPECT_TRUE(RowOf(episode).error_cm.empty()) << text;
  }
}

TEST(EvalReport, GivesWilsonIntervalsPerTaskAndOverall) {
  CampaignSpec spec;
  spec.episodes = 4;
  std::map<std::uint64_t, RolloutRow> rows;
  for (const auto& [index, task, success] : {std::tuple{0, "pick", true}, {1, "pick", true}, {2, "push", false}})
    rows[index] = RowOf(Rollout(index, task, success));
  rows[0].error_cm["TAR3D"] = 1;
  rows[2].error_cm["TAR3D"] = 3;

  const OrderedJson report = EvalReport(spec, rows);

  EXPECT_EQ(report["done"], 3);
  const OrderedJson& pick = report["per_task"][0];
  EXPECT_EQ(pick["n"], 2);
  EXPECT_EQ(pick["success"], 1.0);
  EXPECT_NEAR(pick["low"].get<double>(), 0.342, 1e-3);  // Wilson, 2 of 2
  EXPECT_EQ(report["per_task"][2]["n"], 0) << "put_down has not come yet";
  EXPECT_NEAR(report["overall"]["success"].get<double>(), 2.0 / 3, 1e-9);
  EXPECT_NEAR(report["overall"]["error_cm"]["TAR3D"].get<double>(), 2.0, 1e-9);
  EXPECT_EQ(report["per_episode"].size(), 3u);
  EXPECT_EQ(report["per_episode"][2]["outcome"], "timeout");

  const std::string table = EvalTable(report);
  EXPECT_NE(table.find("66.7"), std::string::npos) << table;
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 5) << "head, three tasks, overall";
}

}  // namespace
}  // namespace etude::campaign
