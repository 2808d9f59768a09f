// SPDX-License-Identifier: Apache-2.0
#include "trainer/serve/insight_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/config.h"

namespace etude::serve {
namespace insight_text_test {

using ::testing::HasSubstr;

TEST(InsightText, SaysWhatWouldBeOtherwise) {
  bus::Insight insight;
  insight.modules_json =
      R"({"LANG": {"entity": "target", "quantity": "class", "unit": "-", "value": "pepsi", "probability": 0.971},
          "TAR3D": {"entity": "target", "quantity": "position", "unit": "m", "value": [0.1, 0.2, 0.3]}})";
  insight.what_if_json =
      R"({"LANG": {"entity": "target", "quantity": "class", "unit": "-", "value": "pepsi", "probability": 0.971},
          "TAR3D": {"entity": "target", "quantity": "position", "unit": "m", "value": [0.5, 0.2, 0.3]}})";
  const std::string text = InsightText(insight);
  EXPECT_THAT(text, HasSubstr("pepsi (0.97)   the same"));
  EXPECT_THAT(text, HasSubstr("target.position        [0.100, 0.200, 0.300] m   instead [0.500, 0.200, 0.300] m"));
  insight.modules_json = "nonsense";
  EXPECT_EQ(InsightText(insight), "");
}

// two heads, a grid of 1 x 2 patches, then three keys
TEST(InsightText, SaysWhereAModuleLooksAndWhatThePlanWouldBe) {
  bus::Insight insight;
  insight.modules_json = R"({"CTRL": {}})";
  insight.attention_json = R"({"CTRL": {"offset": 1, "heads": 2, "image": [1, 2], "keys": ["language", "joints",
      "TAR3D"], "scale": [1.0, 0.5]}})";
  insight.attention = {9, 0, 255, 0, 0, 0, 0, 0, 0, 255, 255};
  insight.waypoints.assign(120, 0.0F);
  insight.what_if_waypoints = insight.waypoints;
  insight.waypoints[110] = 0.25F;
  insight.what_if_waypoints[51] = 0.03F;
  insight.what_if_waypoints[110] = 0.25F;
  insight.what_if_waypoints[119] = 1.0F;
  insight.worth_json = R"({"words": [{"word": "push", "moves": 0.012}], "joints": [0.001]})";

  const std::string text = InsightText(insight);
  EXPECT_THAT(text, HasSubstr("looks at patch (1, 0)  picture 0.50  language 0.00  joints 0.25  modules 0.25"));
  EXPECT_THAT(text, HasSubstr("first [0.000, 0.000, 0.000] m  last [0.250, 0.000, 0.000] m   instead up to 3.0 cm "
                              "elsewhere, gripper changed at 1 of 12"));
  EXPECT_THAT(text, HasSubstr("without: push 1.2; joints 0.1"));
  const auto line = OrderedJson::parse(InsightLine(insight));
  EXPECT_EQ(line["attention"], OrderedJson(insight.attention));
  EXPECT_EQ(line["what_if_waypoints"].size(), 120u);
  EXPECT_EQ(line["worth"]["words"][0]["word"], "push");

  insight.attention.pop_back();  // fewer bytes than are said
  EXPECT_THAT(InsightText(insight), ::testing::Not(HasSubstr("looks at")));
}

}  // namespace insight_text_test
}  // namespace etude::serve
