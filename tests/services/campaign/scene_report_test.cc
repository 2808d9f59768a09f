// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/scene_report.cc
#include "services/campaign/scene_report.h"

#include <gmock/gmock.h>

#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace scene_report_test {

OrderedJson Details(unsigned draws, const std::vector<std::string>& reasons) {
  OrderedJson rejected = OrderedJson::array();
  for (const auto& reason : reasons) rejected.push_back({{"reason", reason}, {"detail", reason}});
  return {{"scene", {{"draws", draws}, {"rejected", rejected}}}};
}

Episode Rollout(std::uint64_t index, unsigned draws, const std::vector<std::string>& reasons) {
  Episode episode;
  episode.index = index;
  episode.details = Details(draws, reasons);
  return episode;
}

TEST(SceneReport, CountsWhatCountsAndWhatDoesNot) {
  SceneReport report;
  report.Add(Rollout(0, 1, {}));
  report.Add(Rollout(1, 2, {"reach: touches"}));
  report.Add(Rollout(1, 2, {"reach: touches"}));  // committed again after a crash
  report.AddFailure(2, "scene_invalid", Details(1, {"reach: out_of_reach"}));
  report.AddFailure(3, "scene_invalid", Details(1, {}));
  report.AddFailure(4, "policy_error", Details(1, {}));

  const OrderedJson json = report.Json("first_draw");

  EXPECT_EQ(json["scenes"], 2u);
  EXPECT_EQ(json["first_draw"], 0.5);
  EXPECT_EQ(json["invalid"], 2u);
  EXPECT_EQ(json["invalid_reasons"]["reach: out_of_reach"], 1u);
  EXPECT_EQ(json["invalid_reasons"]["not settled"], 1u);
  const std::string text = ScenesText({{"scenes", json}});
  EXPECT_THAT(text, testing::HasSubstr("50.0 % of 2 taken at the first draw"));
  EXPECT_THAT(text, testing::HasSubstr("not in n: 2 scenes"));
  EXPECT_EQ(ScenesText(OrderedJson::object()), "");
}

TEST(SceneReport, SaysWhyASceneDoesNotCount) {
  SceneReport report;
  // an evaluation that draws until the task can be done: every draw was refused, for one reason or for several
  report.AddFailure(0, "scene_invalid", Details(2, {"reach: touches", "reach: touches"}));
  report.AddFailure(1, "scene_invalid", Details(2, {"reach: touches", "lift: out_of_reach"}));
  // the last of three was taken, and then the objects did not come to rest
  report.AddFailure(2, "scene_invalid", Details(3, {"reach: touches", "reach: touches"}));
  report.AddFailure(3, "scene_invalid", OrderedJson::object());
  const OrderedJson reasons = report.Json("feasible")["invalid_reasons"];
  EXPECT_EQ(reasons, (OrderedJson{{"no start in 2 draws", 1u}, {"not settled", 2u}, {"reach: touches", 1u}}));
  EXPECT_EQ(report.Json("feasible")["filter"], "feasible");
}

TEST(SceneReport, ASceneThatCountsAfterAllIsNotLeftOut) {
  SceneReport report;
  report.AddFailure(5, "scene_invalid", Details(1, {"a"}));
  report.AddFailure(6, "scene_invalid", Details(1, {"a"}));
  report.AddFailure(6, "scene_invalid", Details(1, {"b"}));
  report.Add(Rollout(5, 1, {}));
  const OrderedJson json = report.Json("first_draw");
  EXPECT_EQ(json["invalid"], 1u);
  EXPECT_EQ(json["invalid_reasons"], (OrderedJson{{"b", 1u}})) << "the last attempt at scene 6";
  EXPECT_EQ(json["scenes"], 1u);
}

TEST(SceneReport, AsText) {
  SceneReport report;
  for (std::uint64_t i = 0; i < 3; ++i) report.Add(Rollout(i, 1, {}));
  report.Add(Rollout(3, 4, {"reach: touches", "approach: touches", "reach: touches"}));
  EXPECT_EQ(ScenesText({{"scenes", report.Json("feasible")}}),
            "scenes: 75.0 % of 4 taken at the first draw, 7 draws\nrejected: reach: touches 2, approach: touches 1\n");
  EXPECT_EQ(ScenesText({{"scenes", SceneReport().Json("feasible")}}), "") << "an evaluation that has not begun";
  EXPECT_EQ(ScenesText(OrderedJson(3)), "");
}

TEST(SceneReport, KnowsAfterARestartWhatWasInvalid) {
  TemporaryFolder folder;
  const OrderedJson line{{"index", 7u}, {"attempt", 0u}, {"outcome", "scene_invalid"}, {"details", Details(1, {"a"})}};
  ASSERT_TRUE(WriteFileAtomically(folder / "attempts.jsonl", line.dump() + "\nnot json\n[3]\n"));
  SceneReport report;
  report.Restore(folder.path());
  EXPECT_EQ(report.Json("first_draw")["invalid"], 1u);
}

// What another version, a crash or a stranger left in the file harms nothing and counts for nothing.
TEST(SceneReport, ReadsOverLinesThatSayNothing) {
  TemporaryFolder folder;
  std::string lines;
  for (
      const char* line :
      {R"({"index": 1, "attempt": 0, "outcome": "scene_invalid", "details": {"scene": {"draws": 1, "rejected": [{"reason": "a"}]}}})",
       R"({"index": 2, "attempt": 0, "outcome": "scene_invalid"})", R"({"index": -3, "outcome": "scene_invalid"})",
       R"({"index": "4", "outcome": "scene_invalid"})", R"({"outcome": "scene_invalid"})",
       R"({"index": 5, "outcome": 7})", R"({"index": 6, "outcome": "dropped"})", "", "{"})
    lines += std::string(line) + "\n";
  ASSERT_TRUE(WriteFileAtomically(folder / "attempts.jsonl", lines));
  SceneReport report;
  report.Restore(folder.path());
  EXPECT_EQ(report.Json("first_draw")["invalid_reasons"], (OrderedJson{{"a", 1u}, {"not settled", 1u}}));
  SceneReport nothing;
  nothing.Restore(folder / "none");
  EXPECT_EQ(nothing.Json("first_draw")["invalid"], 0u);
}

}  // namespace scene_report_test
}  // namespace etude::campaign
