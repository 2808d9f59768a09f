// SPDX-License-Identifier: Apache-2.0
#include "services/cli/results_report.h"

#include <gtest/gtest.h>

namespace etude::cli {
namespace results_report_test {

TEST(IsWholeReport, CountsScenesThatDoNotCount) {
  const OrderedJson report{{"done", 9}, {"scenes", {{"invalid", 1}}}};
  EXPECT_TRUE(IsWholeReport(report, 10));
  EXPECT_FALSE(IsWholeReport(report, 11));
  EXPECT_TRUE(IsWholeReport({{"done", 10}}, 10)) << "of a version that did not count them";
  EXPECT_FALSE(IsWholeReport({{"done", "ten"}}, 1));
  EXPECT_FALSE(IsWholeReport({{"done", 9}, {"scenes", {{"invalid", -1}}}}, 10));
  EXPECT_FALSE(IsWholeReport({{"done", 9}, {"scenes", 1}}, 10));
  EXPECT_FALSE(IsWholeReport(OrderedJson::array(), 0));
  EXPECT_FALSE(IsWholeReport(OrderedJson::parse("not json", nullptr, false), 0));
}

TEST(BriefReport, KeepsWhatTablesShow) {
  const OrderedJson report{{"overall", 1}, {"per_task", 2}, {"per_episode", OrderedJson::array({1, 2, 3})}};
  EXPECT_EQ(BriefReport(report), (OrderedJson{{"overall", 1}, {"per_task", 2}}));
  const OrderedJson more{
      {"scenes", {{"first_draw", 0.5}, {"reasons", 7}}},
      {"comparison", {{"overall", {{"p", 0.1}}}, {"per_task", 3}, {"with", "b"}, {"with_sha256", "2f"}}}};
  EXPECT_EQ(BriefReport(more),
            (OrderedJson{{"scenes", {{"first_draw", 0.5}}},
                         {"comparison", {{"overall", {{"p", 0.1}}}, {"with", "b"}, {"with_sha256", "2f"}}}}));
  EXPECT_EQ(BriefReport(OrderedJson::array()), OrderedJson::object());
}

TEST(BriefReport, KeepsWhyAComparisonIsMissing) {
  const OrderedJson report{{"overall", 1}, {"comparison", {{"with", "b"}, {"missing", "not there"}}}};
  EXPECT_EQ(BriefReport(report), report);
  EXPECT_EQ(MissingComparison(report), "not there");
  EXPECT_EQ(MissingComparison({{"comparison", {{"overall", 1}}}}), "");
  EXPECT_EQ(MissingComparison({{"comparison", {{"missing", 3}}}}), "");
  EXPECT_EQ(MissingComparison(OrderedJson::array()), "");
}

TEST(RolloutsHash, IsThatOfWhatIsKeptOfThem) {
  const OrderedJson report{{"overall", {{"n", 10}, {"error_cm", {{"TAR3D", 0.1}}}}}, {"per_episode", {1, 2}}};
  EXPECT_EQ(RolloutsHash(BriefReport(report)), RolloutsHash(report));
  EXPECT_EQ(RolloutsHash(OrderedJson::parse(report.dump(1))), RolloutsHash(report)) << "read from a file";
  OrderedJson other = report;
  other["overall"]["error_cm"]["TAR3D"] = 0.2;
  EXPECT_NE(RolloutsHash(other), RolloutsHash(report));
  EXPECT_EQ(RolloutsHash(OrderedJson::array()), RolloutsHash(OrderedJson::object()));
}

}  // namespace results_report_test
}  // namespace etude::cli
