// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/insight.cc where insights come from files; live_test.cc has those of a policy server.
#include <gmock/gmock.h>

#include "services/policy/insight_file.h"
#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/dashboard/server/api/json_schema.h"
#include "tests/support/matchers.h"

namespace etude::api {
namespace insight_test {

using testing::HasSubstr;
using testing::IsEmpty;

constexpr std::uint64_t kIndex = 2;

policy::Insight Said() {
  policy::Insight insight;
  insight.checkpoint_step = 200;
  insight.modules["LANG"] = {{"entity", "target"}, {"quantity", "class"}, {"value", "coke"}};
  insight.attention["TAR2D"] = {1, 2, {"language"}, {{0.25, 0.5}, {0.25}}, {{{0, 0.5}, {0.5}}, {{0.5, 0.5}, {0}}}};
  insight.view = {4, 2, 20, 16};
  insight.waypoints.resize(kWaypoints);
  return insight;
}

// A rollout of eval_a with decisions at steps 0, 12 (no picture) and 20, the first of which has no insight.
class KeptInsightTest : public ApiFixture {
 protected:
  KeptInsightTest() : document_(OrderedJson::parse(dashboard::OpenApiText())) {
    const CampaignSpec spec = store::DatasetReader::Open(folder_ / "rollouts").value().spec();
    episode_ = MakeSyntheticEpisode(spec, kIndex, kSteps);
    auto writer = store::DatasetWriter::Open(folder_ / "rollouts", spec);
    EXPECT_THAT(writer, IsOk());
    if (!writer) return;
    EXPECT_THAT(writer->Commit(episode_), IsOk());
    Write({kIndex, episode_.seed, episode_.attempt});
  }
  void Write(const policy::InsightsOf& of) {
    EXPECT_THAT(policy::WriteInsightFile(file_, of, {{0, std::nullopt}, {12, Said()}, {20, Said()}}), IsOk());
  }
  std::vector<std::string> Problems(const char* schema, const OrderedJson& value) {
    std::vector<std::string> problems;
    CheckSchema(document_, document_["components"]["schemas"][schema], value, "", problems);
    return problems;
  }

  const Path folder_ = lab_.root() / "eval_a";
  const Path file_ = folder_ / "insights" / policy::InsightFileName(kIndex);
  const std::string address_ = kPrefix + "/evals/lab.eval_a/insights/2";
  const OrderedJson document_;
  Episode episode_;
};

TEST_F(KeptInsightTest, ListsTheDecisionsOfARollout) {
  const auto kept = GetJson(address_);
  EXPECT_THAT(Problems("KeptInsights", kept), IsEmpty());
  EXPECT_EQ(kept["dataset"], "lab.eval_a.rollouts");
  EXPECT_EQ(kept["instruction"], episode_.instruction);
  ASSERT_EQ(episode_.image_stride, 5);
  EXPECT_EQ(kept["decisions"], OrderedJson::parse(R"([{"step": 0, "picture": 0, "kept": false},
                                                      {"step": 12, "picture": null, "kept": true},
                                                      {"step": 20, "picture": 4, "kept": true}])"));
}

TEST_F(KeptInsightTest, SaysOfADecisionWhatALivePolicyWould) {
  const auto json = GetJson(address_ + "/2");
  EXPECT_THAT(Problems("Insight", json), IsEmpty());
  EXPECT_EQ(json["run"], "example");
  EXPECT_EQ(json["checkpoint_step"], 200);
  EXPECT_EQ(json["sentence"], episode_.instruction);
  EXPECT_EQ(json["modules"]["LANG"]["value"], "coke");
  EXPECT_EQ(json["attention"]["TAR2D"]["heads"].size(), 2u);
  EXPECT_EQ(json["attention"]["TAR2D"]["heads"][1]["weights"], OrderedJson::parse("[0.5, 0.5]"));
  EXPECT_EQ(json["view"]["width"], 20);
  EXPECT_EQ(json["waypoints"].size(), static_cast<std::size_t>(kWaypoints));
  EXPECT_TRUE(json["what_if"].is_null());
  EXPECT_EQ(json["joints"][0]["value"], episode_.joint_pos.row(20)[0]) << "at that decision's step";
  EXPECT_TRUE(json["joints"][0]["moves_m"].is_null());
  EXPECT_EQ(json["truth"]["errors"]["LANG"]["truth"], episode_.target);
  EXPECT_THAT(json["truth"]["waypoints"], IsEmpty()) << "commands of a rollout are a policy's own";
}

TEST_F(KeptInsightTest, WhatIsNotThereIsNotFound) {
  const std::string eval = kPrefix + "/evals/lab.eval_a/insights/";
  for (const std::string& address : {address_ + "/0", address_ + "/3", address_ + "/x", eval + "1", eval + "1/0",
                                     eval + "..%2F..%2Feval.json", kPrefix + "/evals/none/insights/2"})
    EXPECT_EQ(Get(address).status, 404) << address;
  EXPECT_THAT(Get(eval + "1").body, HasSubstr("no insights were kept"));
}

TEST_F(KeptInsightTest, IsNotOfARolloutThatWasMadeAnew) {
  Write({kIndex, episode_.seed, episode_.attempt + 1});
  EXPECT_EQ(Get(address_).status, 404);
  EXPECT_THAT(Get(address_ + "/2").body, HasSubstr("another attempt"));
}

TEST_F(KeptInsightTest, ALinkToAnotherFileIsNotFollowed) {
  const Path elsewhere = lab_.root() / "elsewhere.insights";
  std::filesystem::rename(file_, elsewhere);
  std::filesystem::create_symlink(elsewhere, file_);
  EXPECT_EQ(Get(address_).status, 404);
  std::filesystem::remove(file_);
  std::filesystem::rename(elsewhere, file_);
  EXPECT_EQ(Get(address_).status, 200);
}

TEST_F(KeptInsightTest, AStepThatTheRecordDoesNotHaveIsNoCrash) {
  ASSERT_THAT(policy::WriteInsightFile(file_, {kIndex, episode_.seed, episode_.attempt}, {{1'000'000, Said()}}),
              IsOk());
  EXPECT_EQ(Get(address_).status, 200);
  const auto answer = Get(address_ + "/0");
  EXPECT_EQ(answer.status, 422) << "the file is damaged";
  EXPECT_THAT(answer.body, HasSubstr("no step 1000000"));
}

TEST_F(KeptInsightTest, RowsAndTheReportSayWhatIsKept) {
  EXPECT_EQ(GetJson(kPrefix + "/evals/lab.eval_a")["insights"], 0);
  auto report = OrderedJson::parse(ReadTextFile(folder_ / "eval.json").value());
  report["per_episode"][kIndex]["insight"] = "../../somewhere/else";
  ASSERT_THAT(WriteFileAtomically(lab_.root() / "eval_b" / "eval.json", report.dump()), IsOk());
  EXPECT_EQ(GetJson(kPrefix + "/evals/lab.eval_b")["insights"], 1);
  const auto rows = GetJson(kPrefix + "/evals/lab.eval_b/rows");
  EXPECT_THAT(Problems("EvalRows", rows), IsEmpty());
  EXPECT_EQ(rows["rows"][kIndex]["insight"], true) << "which file it is, the number says alone";
  EXPECT_EQ(rows["rows"][0]["insight"], false);
}

}  // namespace insight_test
}  // namespace etude::api
