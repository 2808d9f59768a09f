// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/results_table.cc and the shipped table
#include "services/cli/results_table.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/config_reference.h"

namespace etude::cli {
namespace {

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
  row.train.freeze = {"LANG", "image"};
  return row;
}

// means over seeds, the interval over all rollouts
TEST(ResultsTable, HasBothCriteriaWithIntervalsAndEverySeed) {
  const ResultRow row = Row(95);
  const std::string table =
      ResultsTable({{&row, {{1, "then", Report(100, 90, 100)}, {2, "now", Report(100, 96, 98)}}}});

  EXPECT_THAT(table,
              HasSubstr("| UR5 | 600 | 10 min | base + obstacle, 2 parts frozen | 93.0 [88.6, 95.8] | 90.0, 96.0 | "
                        "99.0 [96.4, 99.7] | 82.4 | 95 (missed) | now; then |"));
  EXPECT_THAT(table, HasSubstr("| UR5 | pick | 93.0 [88.6, 95.8] | 99.0 [96.4, 99.7] |"));
  const ResultRow easy = Row(90);
  EXPECT_THAT(ResultsTable({{&easy, {{1, "now", Report(100, 96, 98)}}}}), Not(HasSubstr("missed")));
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

TEST(ResultsTable, LeavesOutWhatWasNotMeasuredAndSurvivesOddReports) {
  const ResultRow row = Row(0);
  EXPECT_THAT(ResultsTable({{&row, {}}}), Not(HasSubstr("UR5")));
  const std::string odd = ResultsTable({{&row, {{1, "now", OrderedJson::object()}}}});
  EXPECT_THAT(odd, HasSubstr("| UR5 | 600 | 10 min | base + obstacle, 2 parts frozen | - |"));
}

TEST(ResultsConfig, TheShippedTableIsValid) {
  const auto config = LoadConfig<ResultsConfig>("deploy/docs/results.yaml");
  ASSERT_TRUE(config) << config.error().message;
  const Status valid = config->Validate();
  EXPECT_TRUE(valid) << valid.error().message;
  EXPECT_THAT(MissingFromReference(ConfigReference<ResultsConfig>()), testing::IsEmpty());
}

TEST(ResultsConfig, NamesEveryProblem) {
  ResultsConfig config;
  config.rows = {Row(0), Row(0)};
  config.rows[0].train.minutes = 0;
  config.rows[1].data.campaign.clear();
  const Status status = config.Validate();
  ASSERT_FALSE(status);
  for (const char* part : {"a: train: needs minutes or steps", "a: data.campaign: missing", "'a' stands twice",
                           "'base' is no row before it"})
    EXPECT_THAT(status.error().message, HasSubstr(part));
}

}  // namespace
}  // namespace etude::cli
