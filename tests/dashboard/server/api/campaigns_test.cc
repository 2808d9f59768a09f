// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/campaigns.cc: the list of attempts.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <map>
#include <set>
#include <utility>

#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/support/matchers.h"

namespace etude::api {
namespace campaigns_test {

using testing::ElementsAre;
using testing::IsEmpty;

class CampaignsTest : public ApiFixture {
 protected:
  // Episodes 5, 4, ..., 0 are committed in this order; `failures` are lines of attempts.jsonl.
  void WriteLate(const std::string& failures) {
    const CampaignSpec spec = SyntheticSpec();
    auto writer = store::DatasetWriter::Open(lab_.root() / "late", spec);
    ASSERT_THAT(writer, IsOk());
    for (std::uint64_t i = 6; i-- > 0;) ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec, i, 10)), IsOk());
    ASSERT_THAT(WriteFileAtomically(lab_.root() / "late" / "attempts.jsonl", failures), IsOk());
  }
  std::vector<std::uint64_t> Indices(const std::string& query = "") {
    std::vector<std::uint64_t> indices;
    const auto list = GetJson(kPrefix + "/campaigns/lab.late/attempts" + query);
    for (const auto& row : list["rows"]) indices.push_back(row["index"]);
    return indices;
  }
};

// before, rows with a time and rows without were compared by different things, which is no order at all
TEST_F(CampaignsTest, AttemptsAreByIndexWhereATimeIsMissing) {
  WriteLate(
      "{\"index\":3,\"attempt\":0,\"outcome\":\"slip\"}\n"
      "{\"index\":9,\"attempt\":0,\"outcome\":\"slip\",\"details\":{\"t\":1000}}\n");
  EXPECT_THAT(Indices(), ElementsAre(9, 5, 4, 3, 3, 2, 1, 0));
}

TEST_F(CampaignsTest, AttemptsAreByTimeWhereAllHaveOne) {
  WriteLate(
      "{\"index\":3,\"attempt\":0,\"outcome\":\"slip\",\"details\":{\"t\":4000000000}}\n"
      "{\"index\":9,\"attempt\":0,\"outcome\":\"slip\",\"details\":{\"t\":1000}}\n");
  const auto indices = Indices();
  ASSERT_EQ(indices.size(), 8u);
  EXPECT_EQ(indices.front(), 3u) << "the newest";
  EXPECT_EQ(indices.back(), 9u);
}

// before, a demonstration whose scene was invalid was drawn as given up, though its collector tries it again
TEST_F(CampaignsTest, ACellIsGivenUpWhenItsAttemptsAre) {
  WriteLate(
      "{\"index\":3,\"attempt\":0,\"outcome\":\"slip\"}\n"
      "{\"index\":7,\"attempt\":0,\"outcome\":\"scene_invalid\"}\n");
  auto cells = GetArrays(kPrefix + "/campaigns/lab.late/cells").tensors.at("cells").data;
  ASSERT_GT(cells.size(), 8u);
  EXPECT_EQ(cells[2], 1) << "committed";
  EXPECT_EQ(cells[3], 2) << "committed after failures";
  EXPECT_EQ(cells[7], 4) << "failed so far";
  EXPECT_EQ(cells[8], 0) << "open";
}

// before, a shard never came to its end on the pages, and its indices beyond its count had no cells
TEST_F(CampaignsTest, AShardHasCellsForItsOwnEpisodes) {
  WriteLate("{\"index\":7,\"attempt\":0,\"outcome\":\"slip\"}\n");
  ASSERT_THAT(
      WriteFileAtomically(lab_.root() / "late" / "collector.json", R"({"epoch": 1, "ended": "all", "shard": "2/2"})"),
      IsOk());
  const auto content = GetArrays(kPrefix + "/campaigns/lab.late/cells");
  const auto& cells = content.tensors.at("cells").data;
  EXPECT_EQ(cells.size(), SyntheticSpec().episodes / 2);
  EXPECT_EQ(cells[0], 1) << "episode 1";
  EXPECT_EQ(cells[2], 1) << "episode 5";
  EXPECT_EQ(cells[3], 4) << "episode 7";
  EXPECT_EQ(content.metadata.at("first"), "1");
  EXPECT_EQ(content.metadata.at("step"), "2");
}

TEST_F(CampaignsTest, ACellOfARolloutIsGivenUpWhenItsSceneIsInvalid) {
  ASSERT_THAT(WriteFileAtomically(lab_.root() / "eval_a" / "rollouts" / "attempts.jsonl",
                                  "{\"index\":1,\"attempt\":0,\"outcome\":\"scene_invalid\"}\n"
                                  "{\"index\":2,\"attempt\":0,\"outcome\":\"policy_error\"}\n"),
              IsOk());
  const auto cells = GetArrays(kPrefix + "/campaigns/lab.eval_a.rollouts/cells").tensors.at("cells").data;
  ASSERT_EQ(cells.size(), 4u);
  EXPECT_EQ(cells[0], 0);
  EXPECT_EQ(cells[1], 3) << "given up";
  EXPECT_EQ(cells[2], 4) << "asked again";
}

TEST_F(CampaignsTest, PagesHaveEveryAttemptOnce) {
  WriteLate("{\"index\":3,\"attempt\":0,\"outcome\":\"slip\"}\n{\"index\":3,\"attempt\":1,\"outcome\":\"slip\"}\n");
  const auto all = Indices();
  ASSERT_EQ(all.size(), 8u);
  std::vector<std::uint64_t> paged;
  std::string before;
  for (int page = 0; page < 10; ++page) {
    const auto json = GetJson(kPrefix + "/campaigns/lab.late/attempts?limit=3" + before);
    EXPECT_EQ(json["total"], 8);
    for (const auto& row : json["rows"]) paged.push_back(row["index"]);
    if (json["next"].is_null()) break;
    before = "&before=" + json["next"].get<std::string>();
  }
  EXPECT_EQ(paged, all);
  EXPECT_THAT(Indices("?before=99"), IsEmpty());
}

TEST_F(CampaignsTest, FiltersHoldTogether) {
  WriteLate(
      "{\"index\":3,\"attempt\":0,\"outcome\":\"slip\",\"details\":{\"reason\":\"reach: no path\",\"worker\":\"w1\"}}\n"
      "{\"index\":4,\"attempt\":0,\"outcome\":\"timeout\",\"details\":{\"stage\":\"lift\"}}\n");
  EXPECT_THAT(Indices("?outcome=failed"), ElementsAre(4, 3));
  EXPECT_THAT(Indices("?outcome=success"), ElementsAre(5, 4, 3, 2, 1, 0));
  EXPECT_THAT(Indices("?reason=slip&reason=timeout"), ElementsAre(4, 3)) << "values of one key are alternatives";
  EXPECT_THAT(Indices("?stage=reach"), ElementsAre(3)) << "out of the reason's words";
  EXPECT_THAT(Indices("?stage=lift&reason=slip"), IsEmpty());
  EXPECT_THAT(Indices("?worker=w1"), ElementsAre(3));
  EXPECT_THAT(Indices("?index=4"), ElementsAre(4, 4));
  EXPECT_EQ(Get(kPrefix + "/campaigns/lab.late/attempts?outcome=odd").status, 400);
  EXPECT_EQ(Get(kPrefix + "/campaigns/lab.late/attempts?index=-2").status, 400);
}

// before, rows beyond the first 500 were left out, and their reasons' sums with them
TEST_F(CampaignsTest, FailuresOfManyKindsAreAllCounted) {
  std::string failures;
  for (int i = 0; i < 700; ++i)
    failures += fmt::format(R"({{"index":{},"attempt":0,"outcome":"slip","details":{{"stage":"s{}"}}}})", i % 20, i) +
                "\n" + fmt::format(R"({{"index":3,"attempt":{},"outcome":"odd{}"}})", i, i) + "\n";
  WriteLate(failures);
  const auto json = GetJson(kPrefix + "/campaigns/lab.late");
  EXPECT_LE(json["failures_by"].size(), 500u);
  std::map<std::string, std::uint64_t> reasons;
  std::uint64_t sum = 0;
  for (const auto& row : json["failures_by"]) {
    reasons[row["reason"]] += row["count"].get<std::uint64_t>();
    sum += row["count"].get<std::uint64_t>();
  }
  EXPECT_EQ(sum, 1400u);
  EXPECT_GT(reasons["other"], 0u);
  EXPECT_EQ(GetJson(kPrefix + "/campaigns/lab.late/attempts")["campaign"], "lab.late");
}

TEST_F(CampaignsTest, FewMoreKindsThanAreAnsweredKeepTheTableOfReasonsAndTasks) {
  std::string failures;
  std::map<std::pair<std::string, std::string>, std::uint64_t> wanted, found;
  std::set<std::string> tasks;
  for (int i = 0; i < 600; ++i) {
    const std::string reason = i % 3 == 0 ? "slip" : "timeout";
    const auto index = static_cast<std::uint64_t>(i % 20);
    const std::string task = PlanEpisode(SyntheticSpec(), index, 0).task.text();  // as of every failure of the index
    tasks.insert(task);
    ++wanted[{reason, task}];
    failures +=
        fmt::format(R"({{"index":{},"attempt":{},"outcome":"{}","details":{{"stage":"s{}"}}}})", index, i, reason, i) +
        "\n";
  }
  ASSERT_GT(tasks.size(), 1u);
  WriteLate(failures);
  const auto rows = GetJson(kPrefix + "/campaigns/lab.late")["failures_by"];
  for (const auto& row : rows) found[{row["reason"], row["task"]}] += row["count"].get<std::uint64_t>();
  EXPECT_EQ(found, wanted);
  EXPECT_LE(rows.size(), 500u);
}

TEST_F(CampaignsTest, SeedsOfAttemptsAreThoseThatWouldBeDrawn) {
  WriteLate("{\"index\":9,\"attempt\":2,\"outcome\":\"slip\"}\n");
  const auto rows = GetJson(kPrefix + "/campaigns/lab.late/attempts?outcome=success")["rows"];
  for (const auto& row : rows)
    EXPECT_EQ(row["seed"], std::to_string(EpisodeSeed(SyntheticSpec(), row["index"], row["attempt"])));
}

TEST_F(CampaignsTest, TimingIsTheSumOfItsAttempts) {
  WriteLate(R"({"index":3,"attempt":0,"outcome":"slip","details":{"plan_s":0.25,"step_s":0.5,"render_s":0.125}})"
            "\n"
            R"({"index":4,"attempt":0,"outcome":"slip","details":{"plan_s":0.015,"step_s":1.5}})"
            "\n"
            R"({"index":4,"attempt":1,"outcome":"slip"})"
            "\n");
  const auto timing = GetJson(kPrefix + "/campaigns/lab.late")["timing"];
  EXPECT_EQ(timing["attempts"], 2) << "those that say";
  EXPECT_DOUBLE_EQ(timing["plan_s"].get<double>(), 0.265);
  EXPECT_EQ(timing["step_s"], 2.0);
  EXPECT_EQ(timing["render_s"], 0.125);
  // edges 0, 0.01, 0.02, 0.04, ...: 0.015 is in the second bin, 0.25 in the sixth
  const auto& counts = timing["plan_histogram"]["counts"];
  const auto& edges = timing["plan_histogram"]["edges_s"];
  ASSERT_EQ(edges.size(), counts.size() + 1);
  for (std::size_t bin = 0; bin < counts.size(); ++bin) {
    int expected = 0;
    for (const double plan : {0.25, 0.015})
      expected += plan >= edges[bin].get<double>() && plan < edges[bin + 1].get<double>() ? 1 : 0;
    EXPECT_EQ(counts[bin], expected) << bin;
  }
}

}  // namespace campaigns_test
}  // namespace etude::api
