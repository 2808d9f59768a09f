// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/scene_report.cc
#include "services/campaign/scene_report.h"

#include <gmock/gmock.h>

#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace {

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

TEST(SceneReport, KnowsAfterARestartWhatWasInvalid) {
  TemporaryFolder folder;
  const OrderedJson line{{"index", 7u}, {"attempt", 0u}, {"outcome", "scene_invalid"}, {"details", Details(1, {"a"})}};
  ASSERT_TRUE(WriteFileAtomically(folder / "attempts.jsonl", line.dump() + "\nnot json\n[3]\n"));
  SceneReport report;
  report.Restore(folder.path());
  EXPECT_EQ(report.Json("first_draw")["invalid"], 1u);
}

}  // namespace
}  // namespace etude::campaign
