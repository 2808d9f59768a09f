// SPDX-License-Identifier: Apache-2.0
// Tests services/episode/attempt_details.cc
#include "services/episode/attempt_details.h"

#include <gmock/gmock.h>

namespace etude {
namespace attempt_details_test {

OrderedJson Scene(int draws, const std::vector<std::string>& reasons) {
  OrderedJson rejected = OrderedJson::array();
  for (const auto& reason : reasons) rejected.push_back({{"reason", reason}, {"detail", reason + " at (1, 2, 3)"}});
  return {{"scene", {{"draws", static_cast<unsigned>(draws)}, {"rejected", rejected}}}};
}

TEST(SceneTally, CountsFirstDrawsAndReasons) {
  SceneTally tally, more;
  tally.Add(Scene(1, {}));
  tally.Add(Scene(3, {"reach: out_of_reach", "no_arm_start"}));
  more.Add(Scene(1, {}));
  more.Add(Scene(2, {"reach: out_of_reach"}));
  tally.Add(more);

  EXPECT_EQ(tally.scenes, 4u);
  EXPECT_EQ(tally.draws, 7u);
  EXPECT_THAT(tally.rejected,
              testing::ElementsAre(testing::Pair("no_arm_start", 1u), testing::Pair("reach: out_of_reach", 2u)));
  EXPECT_EQ(tally.Json()["first_draw"], 0.5);
  EXPECT_FALSE(SceneTally{}.Json().contains("first_draw")) << "nothing to have a share of";
}

TEST(SceneTally, LeavesOutWhatIsOfAnotherKind) {
  SceneTally tally;
  for (const char* details :
       {"3", "[]", "{}", R"({"scene": 1})", R"({"scene": {"draws": -1}})", R"({"scene": {"draws": "2"}})"})
    tally.Add(OrderedJson::parse(details));
  EXPECT_EQ(tally.scenes, 0u);
  for (const char* details :
       {R"({"scene": {"draws": 1, "rejected": 3}})", R"({"scene": {"draws": 2, "rejected": [3]}})",
        R"({"scene": {"draws": 2, "rejected": [{"reason": 1}]}})"})
    tally.Add(OrderedJson::parse(details));
  EXPECT_EQ(tally.scenes, 3u);
  EXPECT_TRUE(tally.rejected.empty());
}

TEST(SceneTally, DoesNotGrowWithReasonsOfAStranger) {
  SceneTally tally;
  for (int i = 0; i < 2000; ++i) tally.Add(Scene(2, {"reason " + std::to_string(i)}));
  tally.Add(Scene(2, {std::string(1 << 20, 'x')}));
  EXPECT_LE(tally.rejected.size(), 257u);
  std::uint64_t sum = 0;
  for (const auto& [reason, count] : tally.rejected) sum += count;
  EXPECT_EQ(sum, 2001u) << "all are counted";
}

TEST(PlanTally, GivesSharesPerStage) {
  PlanTally tally;
  tally.Add(OrderedJson::parse(R"({"planned": [{"stage": "reach", "way": "line"}, {"stage": "reach", "way": "rrt"},
                                               {"stage": "lift", "way": "line"}, {"stage": 3}, 4]})"));
  tally.Add(
      OrderedJson::parse(R"({"planned": [{"stage": "reach", "way": "line"}, {"stage": "reach", "way": "line"}]})"));
  const OrderedJson json = tally.Json();
  EXPECT_EQ(json["reach"]["times"], 4u);
  EXPECT_EQ(json["reach"]["line"], 0.75);
  EXPECT_EQ(json["reach"]["rrt"], 0.25);
  EXPECT_EQ(json["lift"]["line"], 1.0);
}

TEST(Text, HasTheMostFrequentFirst) {
  EXPECT_EQ(Text(Counts{{"a", 2}, {"b", 9}, {"c", 2}}), "b 9, a 2, c 2");
  EXPECT_EQ(Text(Counts{}), "");
}

}  // namespace attempt_details_test
}  // namespace etude
