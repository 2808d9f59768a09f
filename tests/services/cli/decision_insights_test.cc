// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/decision_insights.cc
#include "services/cli/decision_insights.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "services/episode/frame_cursor.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace decision_insights_test {

// 50 steps, a picture every 5 of them, with a decision of checkpoint 7 at each of `steps`.
Episode Rollout(const std::vector<int>& steps) {
  Episode rollout = MakeSyntheticEpisode(SyntheticSpec(), 3);
  rollout.details["decisions"] = OrderedJson::array();
  for (const int step : steps) rollout.details["decisions"].push_back({{"step", step}, {"checkpoint_step", 7}});
  return rollout;
}

policy::Insight InsightOf(std::uint64_t checkpoint_step) {
  policy::Insight insight;
  insight.checkpoint_step = checkpoint_step;
  return insight;
}

TEST(AskInsights, AsksWhatThePolicyWasAsked) {
  const Episode rollout = Rollout({0, 20});
  std::vector<policy::Question> asked;
  std::vector<std::vector<std::uint8_t>> pictures;
  InsightTally tally;
  const auto insights = AskInsights(
      rollout,
      [&](const policy::Question& question) -> Result<policy::Insight> {
        asked.push_back(question);
        pictures.emplace_back(question.rgb.begin(), question.rgb.end());
        return InsightOf(7);
      },
      tally);

  ASSERT_THAT(insights, IsOk());
  ASSERT_EQ(asked.size(), 2u);
  const auto arm = rollout.joint_pos.row(20), gripper = rollout.gripper_qpos.row(20);
  std::vector<float> joints(arm.begin(), arm.end());
  joints.insert(joints.end(), gripper.begin(), gripper.end());
  EXPECT_EQ(asked[1].joints, joints) << "bit for bit";
  EXPECT_NE(asked[0].joints, joints);
  EXPECT_EQ(asked[1].instruction, rollout.instruction);
  EXPECT_EQ(asked[1].robot, rollout.robot);
  EXPECT_EQ(asked[1].width, 32);
  EXPECT_EQ(asked[1].height, 32);
  ASSERT_TRUE(asked[1].camera);
  EXPECT_EQ(asked[1].camera->fovy, rollout.cameras[0].camera.fovy);
  EXPECT_EQ(asked[1].camera->X_WC.p, rollout.cameras[0].camera.X_WC.p);
  FrameCursor frames(rollout);
  const auto picture = frames.Frame(4);
  ASSERT_THAT(picture, IsOk());
  EXPECT_TRUE(std::ranges::equal(pictures[1], *picture)) << "of step 20, the fifth that was recorded";
  EXPECT_NE(pictures[0], pictures[1]);
}

TEST(AskInsights, KeepsWhatWasSaidByItsStepAndCountsTheRest) {
  const Episode rollout = Rollout({0, 10, 13, 20, 30});
  InsightTally tally;
  int question = 0;
  const auto insights = AskInsights(
      rollout,
      [&](const policy::Question&) -> Result<policy::Insight> {
        ++question;
        if (question == 2) return Fail(Code::kUnavailable, "too late");
        return InsightOf(question == 3 ? 8 : 7);
      },
      tally);

  ASSERT_THAT(insights, IsOk());
  ASSERT_EQ(insights->size(), 5u);
  EXPECT_TRUE(insights->at(0));
  EXPECT_FALSE(insights->at(10)) << "unanswered";
  EXPECT_FALSE(insights->at(13)) << "no picture was recorded at step 13";
  EXPECT_FALSE(insights->at(20)) << "the server has gone on to another checkpoint";
  EXPECT_TRUE(insights->at(30));
  EXPECT_EQ(question, 4) << "nothing is asked about a picture that is not there";
  EXPECT_EQ(tally.decisions, 5u);
  EXPECT_EQ(tally.shown, 2u);
  EXPECT_EQ(tally.Text(),
            "overlay: 2 of 5 decisions; without: 1 by another checkpoint than the one that is served now, 1 at a step "
            "without a recorded picture (see rollout.replan_steps and image_stride), 1 without an answer (too late)");
}

TEST(AskInsights, ManyRolloutsHaveOneTally) {
  InsightTally tally;
  const auto ask = [](const policy::Question&) -> Result<policy::Insight> { return InsightOf(7); };
  ASSERT_THAT(AskInsights(Rollout({0, 10}), ask, tally), IsOk());
  ASSERT_THAT(AskInsights(Rollout({0}), ask, tally), IsOk());
  EXPECT_EQ(tally.Text(), "overlay: 3 of 3 decisions");
}

TEST(AskInsights, LeavesOutDecisionsThatItCannotRead) {
  Episode rollout = Rollout({0});
  auto& decisions = rollout.details["decisions"];
  for (const char* odd : {"7", "{}", R"({"step": -5, "checkpoint_step": 7})", R"({"step": 50, "checkpoint_step": 7})",
                          R"({"step": 2.5, "checkpoint_step": 7})", R"({"step": 5})"})
    decisions.push_back(OrderedJson::parse(odd));
  InsightTally tally;
  const auto ask = [](const policy::Question&) -> Result<policy::Insight> { return InsightOf(7); };
  const auto insights = AskInsights(rollout, ask, tally);
  ASSERT_THAT(insights, IsOk());
  EXPECT_EQ(insights->size(), 1u);
  EXPECT_EQ(tally.decisions, 1u);
  rollout.details = OrderedJson::object();
  EXPECT_TRUE(AskInsights(rollout, ask, tally)->empty()) << "an expert's demonstration has none";
}

TEST(AskInsights, ADamagedPictureIsAnError) {
  Episode rollout = Rollout({0});
  rollout.cameras[0].streams[0] = {1, 2, 3};
  InsightTally tally;
  const auto ask = [](const policy::Question&) -> Result<policy::Insight> { return InsightOf(7); };
  EXPECT_THAT(AskInsights(rollout, ask, tally), HasCode(Code::kCorrupt));
}

class WriteInsightsTest : public testing::Test {
 protected:
  // Two rollouts with decisions at steps 0 and 20.
  WriteInsightsTest() {
    CampaignSpec spec = SyntheticSpec();
    spec.mode = "rollout";
    spec.rollout.run = "demo";
    auto writer = store::DatasetWriter::Open(rollouts_, spec);
    EXPECT_THAT(writer, IsOk());
    for (std::uint64_t i = 0; writer && i < 2; ++i) {
      Episode rollout = MakeSyntheticEpisode(spec, i);
      for (const int step : {0, 20}) rollout.details["decisions"].push_back({{"step", step}, {"checkpoint_step", 7}});
      EXPECT_THAT(writer->Commit(rollout), IsOk());
    }
  }
  Result<std::vector<Path>> Write(const InsightFunction& ask) {
    return WriteInsights(rollouts_, folder_ / "insights", ask, tally_);
  }

  TemporaryFolder folder_;
  const Path rollouts_ = folder_ / "rollouts";
  InsightTally tally_;
};

TEST_F(WriteInsightsTest, AFileARolloutHoldsItsDecisions) {
  int question = 0;
  const auto files = Write([&](const policy::Question& asked) -> Result<policy::Insight> {
    if (++question == 2) return Fail(Code::kUnavailable, "too late");
    policy::Insight insight = InsightOf(7);
    insight.modules["LANG"] = {{"value", asked.instruction}};
    return insight;
  });

  ASSERT_THAT(files, IsOk());
  EXPECT_EQ(*files, (std::vector<Path>{folder_ / "insights/000000.insights", folder_ / "insights/000001.insights"}));
  const auto reader = store::DatasetReader::Open(rollouts_);
  for (const std::uint64_t i : {0u, 1u}) {
    const Episode rollout = reader->ReadWhole(i).value();
    const auto file = policy::InsightFile::Open((*files)[i]);
    ASSERT_THAT(file, IsOk());
    EXPECT_EQ(file->of(), (policy::InsightsOf{i, rollout.seed, rollout.attempt}));
    ASSERT_EQ(file->decisions().size(), 2u);
    EXPECT_EQ(file->decisions()[1].step, 20);
    EXPECT_EQ(file->decisions()[1].kept(), i == 1) << "what was not answered is not there";
    EXPECT_EQ(file->At(0)->modules["LANG"]["value"], rollout.instruction);
  }
  EXPECT_EQ(tally_.Text("insights"), "insights: 3 of 4 decisions; without: 1 without an answer (too late)");
}

TEST_F(WriteInsightsTest, WhatIsThereIsKeptAndTheRestAskedLater) {
  const auto nobody = [](const policy::Question&) -> Result<policy::Insight> { return Fail(Code::kUnavailable, "-"); };
  EXPECT_THAT(*Write(nobody), testing::IsEmpty()) << "a file without any would keep a later run from asking";
  int asked = 0;
  const auto ask = [&](const policy::Question&) -> Result<policy::Insight> {
    ++asked;
    return InsightOf(7);
  };
  EXPECT_EQ(Write(ask)->size(), 2u);
  EXPECT_EQ(asked, 4);
  std::filesystem::remove(folder_ / "insights/000001.insights");

  EXPECT_EQ(Write({})->size(), 1u) << "without a policy those that are there";
  EXPECT_EQ(Write(ask)->size(), 2u);

  EXPECT_EQ(asked, 6) << "of the one that is gone";
}

}  // namespace decision_insights_test
}  // namespace etude::cli
