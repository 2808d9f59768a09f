// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/suite_report.cc
#include "services/campaign/suite_report.h"

#include <gmock/gmock.h>

namespace etude::campaign {
namespace suite_report_test {

using testing::HasSubstr;

RolloutRow Row(std::uint64_t index, bool success, bool latched) {
  RolloutRow row;
  row.index = index;
  row.task = "push";
  row.success = success;
  row.success_latched = latched;
  return row;
}

class Suites : public testing::Test {
 protected:
  Suites() {
    spec_.tasks = {"push"};
    for (std::uint64_t i = 0; i < 5; ++i) rows_[i] = Row(i, i < 2, i < 3);
  }
  CampaignSpec spec_;
  std::map<std::uint64_t, RolloutRow> rows_;
};

TEST_F(Suites, AReportWithoutThemSaysNothingOfThem) {
  const OrderedJson report = EvalReport(spec_, rows_);
  for (const char* key : {"occlusion", "pushes", "per_sentence"}) EXPECT_FALSE(report.contains(key)) << key;
  for (const char* key : {"covered", "pushes", "pushes_missed"}) EXPECT_FALSE(report["per_episode"][0].contains(key));
  EXPECT_EQ(SuitesText(report), "");
  EXPECT_EQ(SentencesText(report), "");
}

TEST_F(Suites, OcclusionIsWhatWasAskedForAndWhatWasCovered) {
  spec_.rollout.occlude = 0.42;
  rows_[0].covered = 0.5;
  rows_[1].covered = 0.4;
  const OrderedJson report = EvalReport(spec_, rows_);
  EXPECT_EQ(report["occlusion"]["share"], 0.42);
  EXPECT_NEAR(report["occlusion"]["covered"].get<double>(), 0.45, 1e-12) << "of those that saw the target";
  EXPECT_EQ(report["per_episode"][0]["covered"], 0.5);
  EXPECT_THAT(SuitesText(report), HasSubstr("42 % of the target's pixels asked for, 45.0 % covered"));
  EXPECT_THAT(SuitesText(EvalReport(spec_, {})), HasSubstr("asked for\n"));
}

TEST_F(Suites, PushedRolloutsStandApartFromTheOthers) {
  spec_.rollout.pushes.count = 2;
  for (auto& [index, row] : rows_) row.pushes = 0, row.pushes_missed = 2;
  for (const std::uint64_t index : {0, 2, 3}) rows_[index].pushes = 1, rows_[index].pushes_missed = 1;
  rows_[3].pushes = 2, rows_[3].pushes_missed = 0;
  const OrderedJson pushes = EvalReport(spec_, rows_)["pushes"];
  EXPECT_EQ(pushes["asked"], 2);
  EXPECT_EQ(pushes["made"], 4);
  EXPECT_EQ(pushes["missed"], 6);
  EXPECT_EQ(pushes["rollouts"], 3);
  EXPECT_EQ(pushes["success"]["successes"], 1);
  EXPECT_EQ(pushes["not_pushed"], 2);
  EXPECT_EQ(pushes["success_not_pushed"]["successes"], 1);
  EXPECT_THAT(SuitesText(EvalReport(spec_, rows_)), HasSubstr("pushed: 3 rollouts, success  33.3 ["));
}

TEST_F(Suites, EverySentenceHasARowOfItsScenes) {
  spec_.rollout.sentences = {{"shove the lager", "push", "bottle", ""}, {"shove the loaf", "push", "bread", ""}};
  OrderedJson report = EvalReport(spec_, rows_);
  const OrderedJson& rows = report["per_sentence"];
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[0]["text"], "shove the lager");
  EXPECT_EQ(rows[0]["n"], 3) << "rollouts 0, 2, 4";
  EXPECT_EQ(rows[0]["success"]["successes"], 1);
  EXPECT_EQ(rows[0]["success_latched"]["successes"], 2);
  EXPECT_EQ(rows[1]["n"], 2);
  EXPECT_EQ(rows[1]["success"]["successes"], 1);
  EXPECT_FALSE(rows[0].contains("reference"));
  EXPECT_THAT(SentencesText(report), HasSubstr("shove the loaf       1/2      1/2  push bread"));
  EXPECT_THAT(SentencesText(report), testing::Not(HasSubstr("training never said")));

  report["per_sentence"][0]["never_seen"] = {"shove", "lager"};
  report["per_sentence"][1]["never_seen"] = OrderedJson::array();
  const std::string text = SentencesText(report);
  EXPECT_THAT(text, HasSubstr("push bottle          shove, lager\n"));
  EXPECT_THAT(text, HasSubstr("push bread           -\n"));
  EXPECT_THAT(text, HasSubstr("all sentences, 5 rollouts: success  40.0 ["));
}

TEST(RowOfASuite, ReadsWhatTheWorkerRecorded) {
  Episode episode;
  episode.details = {{"occlusion", {{"share", 0.2}, {"covered", 0.21}, {"pictures", 3}}},
                     {"pushes", {{{"step", 20}}}},
                     {"pushes_missed", 1}};
  const RolloutRow row = RowOf(episode);
  EXPECT_EQ(row.covered, 0.21);
  EXPECT_EQ(row.pushes, 1);
  EXPECT_EQ(row.pushes_missed, 1);
  for (const char* text : {R"({"occlusion": 3, "pushes": {}, "pushes_missed": 4})",
                           R"({"occlusion": {"covered": "all"}, "pushes": "none"})", R"({"occlusion": {}})"}) {
    episode.details = OrderedJson::parse(text);
    EXPECT_FALSE(RowOf(episode).covered) << text;
    EXPECT_FALSE(RowOf(episode).pushes) << text;
  }
}

}  // namespace suite_report_test
}  // namespace etude::campaign
