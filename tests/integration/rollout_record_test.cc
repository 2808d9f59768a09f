// SPDX-License-Identifier: Apache-2.0
// What `etude eval --overlay` rests on: the record of a rollout, committed and read again, holds every bit of what the
// policy was asked. worker/task writes it, services/store keeps it, services/cli asks again.
#include <gtest/gtest.h>

#include "services/cli/decision_insights.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "worker/task/attempt.h"

namespace etude {
namespace rollout_record_test {

struct Asked {
  std::string instruction, robot;
  std::vector<float> joints;
  std::vector<std::uint8_t> rgb;
  Camera camera;
};

Asked CopyOf(const policy::Question& question) {
  return {question.instruction,
          question.robot,
          question.joints,
          {question.rgb.begin(), question.rgb.end()},
          question.camera.value_or(Camera{})};
}

// A hand that goes somewhere and stays.
policy::Answer GoThere() {
  policy::Answer answer;
  answer.waypoints.assign(kWaypoints, Waypoint{{{-0.11, 0.13, 0.2}, FromEuler({3.14, 0, 1.57})}, 0});
  answer.checkpoint_step = 7;
  return answer;
}

CampaignSpec RecordSpec() {
  CampaignSpec spec;
  spec.name = "record";
  spec.mode = "rollout";
  spec.tasks = {"pick"};
  spec.seed = 31;
  spec.camera.width = spec.camera.height = 96;
  spec.rollout.run = "nobody";
  spec.rollout.replan_steps = 20;
  spec.rollout.max_steps = 110;
  spec.rollout.occlude = 0.4;  // the picture is changed after it is rendered
  return spec;
}

void ExpectSame(const Asked& again, const Asked& asked) {
  EXPECT_EQ(again.joints, asked.joints);
  EXPECT_EQ(again.rgb, asked.rgb);
  EXPECT_EQ(again.instruction, asked.instruction);
  EXPECT_EQ(again.robot, asked.robot);
  EXPECT_EQ(again.camera.width, asked.camera.width);
  EXPECT_NEAR(again.camera.fovy, asked.camera.fovy, 1e-9);
  EXPECT_TRUE(again.camera.X_WC.p.isApprox(asked.camera.X_WC.p, 1e-9));
  EXPECT_LT(AngleBetween(again.camera.X_WC.q, asked.camera.X_WC.q), 1e-6);
}

TEST(RolloutRecord, HoldsEveryBitOfWhatThePolicyWasAsked) {
  const CampaignSpec spec = RecordSpec();
  auto runner = task::AttemptRunner::Open(spec);
  ASSERT_THAT(runner, IsOk());
  std::vector<Asked> asked, again;
  const auto rollout = runner->Rollout(0, [&](const policy::Question& question) -> Result<policy::Answer> {
    asked.push_back(CopyOf(question));
    return GoThere();
  });
  ASSERT_THAT(rollout, IsOk());
  ASSERT_EQ(asked.size(), 6u) << "at steps 0, 20, ... 100";

  const TemporaryFolder folder;
  auto writer = store::DatasetWriter::Open(folder / "rollouts", spec);
  ASSERT_THAT(writer, IsOk());
  ASSERT_THAT(writer->Commit(rollout->episode), IsOk());
  const auto reader = store::DatasetReader::Open(folder / "rollouts");
  ASSERT_THAT(reader, IsOk());
  const auto recorded = reader->ReadWhole(0);
  ASSERT_THAT(recorded, IsOk());
  cli::InsightTally tally;
  const auto insights = cli::AskInsights(
      *recorded,
      [&](const policy::Question& question) -> Result<policy::Insight> {
        again.push_back(CopyOf(question));
        policy::Insight insight;
        insight.checkpoint_step = 7;
        return insight;
      },
      tally);
  ASSERT_THAT(insights, IsOk());

  EXPECT_EQ(tally.Text(), "overlay: 6 of 6 decisions");
  ASSERT_EQ(again.size(), asked.size());
  for (std::size_t i = 0; i < asked.size(); ++i) {
    SCOPED_TRACE(i);
    ExpectSame(again[i], asked[i]);
  }
  EXPECT_NE(asked[0].joints, asked[5].joints) << "the hand has moved";
  EXPECT_NE(asked[0].rgb, asked[5].rgb);
}

}  // namespace rollout_record_test
}  // namespace etude
