// SPDX-License-Identifier: Apache-2.0
// Rollouts driven by scripted policies: one that knows the expert's commands, and some that misbehave.
#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <limits>

#include "services/episode/codec.h"
#include "services/episode/frame_cursor.h"
#include "tests/support/replace_in_file.h"
#include "tests/support/temporary_folder.h"
#include "tests/worker/task/playback.h"
#include "tests/worker/task/rollout_spec.h"
#include "worker/task/attempt.h"
#include "worker/task/judge.h"

namespace etude::task {
namespace rollout_test {

CampaignSpec RolloutSpecOf(const std::string& task) {
  CampaignSpec spec = CheapRollout(task, "oracle");
  spec.randomization.disturbance_probability = 0;
  spec.rollout.max_steps = 900;
  return spec;
}

class RolloutOf : public testing::TestWithParam<const char*> {};

TEST_P(RolloutOf, OracleSucceeds) {
  const CampaignSpec spec = RolloutSpecOf(GetParam());
  auto runner = AttemptRunner::Open(spec);
  ASSERT_TRUE(runner.has_value()) << runner.error().message;
  int successes = 0, tried = 0;
  for (int index = 0; index < 4; ++index) {
    const auto demonstration = runner->Demonstrate(index, 0).value();
    if (demonstration.outcome != AttemptOutcome::kSuccess) continue;
    ++tried;
    const auto rollout = runner->Rollout(index, Playback(demonstration.episode, spec.rollout.replan_steps));
    ASSERT_TRUE(rollout.has_value());
    successes += rollout->outcome == AttemptOutcome::kSuccess;
    EXPECT_EQ(rollout->episode.success, rollout->outcome == AttemptOutcome::kSuccess);
    EXPECT_EQ(rollout->episode.target, demonstration.episode.target);
    const auto& details = rollout->episode.details;
    EXPECT_EQ(details["steps"].get<int>(), rollout->episode.steps());
    const auto& first = details["decisions"][0];
    EXPECT_LT(first["error_m"]["EE3D"].get<double>(), 1e-4);
    EXPECT_NEAR(first["error_m"]["TAR3D"].get<double>(), 0.02, 1e-3);
    EXPECT_EQ(first["error_m"].size(), 2u) << "what it did not say, and what has no known truth, is left out";
    EXPECT_TRUE(!rollout->episode.success || details["success_latched"] == true) << "success implies latched";
    if (rollout->episode.success) {
      EXPECT_EQ(details["done_step"].get<int>(), rollout->episode.steps() - 1) << "it ends when it was held";
      EXPECT_LE(details["latched_step"].get<int>(), details["done_step"].get<int>() - kDwell + 1);
      EXPECT_TRUE(details["violations"].empty());
    }
    EXPECT_EQ(first["checkpoint_step"].get<int>(), 7);
  }
  EXPECT_GE(tried, 3);
  EXPECT_GE(successes, tried - (std::string(GetParam()) == "put_down" ? 1 : 0));
}

INSTANTIATE_TEST_SUITE_P(Tasks, RolloutOf, testing::Values("pick", "push", "put_down", "rotate", "place_left"),
                         [](const auto& info) { return std::string(info.param); });

// A task file that somebody wrote elsewhere, named by its path.
TEST(Rollout, OfATaskThatAUserWroteIsJudgedByItsFile) {
  const TemporaryFolder folder;
  const std::string mine = (folder / "lift_up.yaml").string();
  std::filesystem::copy_file("deploy/tasks/pick.yaml", mine);
  ReplaceInFile(mine, "name: pick", "name: lift_up");
  const CampaignSpec spec = RolloutSpecOf(mine);
  auto runner = AttemptRunner::Open(spec);
  ASSERT_TRUE(runner.has_value()) << runner.error().message;
  const auto demonstration = runner->Demonstrate(0, 0).value();
  ASSERT_EQ(demonstration.outcome, AttemptOutcome::kSuccess) << demonstration.reason;
  const auto rollout = runner->Rollout(0, Playback(demonstration.episode, spec.rollout.replan_steps));
  ASSERT_TRUE(rollout.has_value()) << rollout.error().message;
  EXPECT_EQ(rollout->outcome, AttemptOutcome::kSuccess) << rollout->reason;
  EXPECT_EQ(rollout->episode.task, demonstration.episode.task);
}

// What is round is lost by a hand that rises while its fingers close: an answer's time is off by some ten steps.
TEST(Rollout, AGraspSurvivesAnAnswerThatRisesTooEarly) {
  CampaignSpec spec = RolloutSpecOf("pick");
  spec.objects = {"orange_00", "donut_00", "lemon_00", "apple_01"};
  auto runner = AttemptRunner::Open(spec);
  ASSERT_TRUE(runner.has_value()) << runner.error().message;
  for (int index = 0; index < 3; ++index) {
    auto demonstration = runner->Demonstrate(index, 0).value();
    ASSERT_EQ(demonstration.outcome, AttemptOutcome::kSuccess) << demonstration.reason;
    Episode& episode = demonstration.episode;
    constexpr int kLate = 12;
    std::vector<float>& values = episode.actions_abs.values;
    const auto gripper = [&](int t) -> float& { return values[t * kWaypointSize + kWaypointSize - 1]; };
    for (int t = episode.steps() - 1; t >= kLate; --t) gripper(t) = gripper(t - kLate);
    const auto rollout = runner->Rollout(index, Playback(episode, spec.rollout.replan_steps));
    ASSERT_TRUE(rollout.has_value()) << rollout.error().message;
    EXPECT_EQ(rollout->outcome, AttemptOutcome::kSuccess) << rollout->reason;
  }
}

policy::Answer Stay(const Eigen::Vector3d& p) {
  policy::Answer answer;
  answer.waypoints.assign(kWaypoints, Waypoint{{p, FromEuler({3.14, 0, 1.57})}, 0});
  return answer;
}

TEST(Rollout, EndsAtTheStepLimitWhenNothingHappens) {
  CampaignSpec spec = RolloutSpecOf("pick");
  spec.rollout.replan_steps = 15;
  spec.rollout.max_steps = 120;
  spec.rollout.record = false;
  auto runner = AttemptRunner::Open(spec);
  ASSERT_TRUE(runner.has_value()) << runner.error().message;
  int asked = 0;
  const auto rollout = runner->Rollout(0, [&](const policy::Question& question) -> Result<policy::Answer> {
    ++asked;
    EXPECT_FALSE(question.instruction.empty());
    EXPECT_EQ(question.rgb.size(), 64u * 64u * 3u);
    EXPECT_GE(question.joints.size(), 7u);
    return Stay({-0.11, 0.13, 0.2});
  });
  ASSERT_TRUE(rollout.has_value());
  EXPECT_EQ(rollout->outcome, AttemptOutcome::kTimeout);
  EXPECT_EQ(rollout->episode.outcome, "timeout");
  EXPECT_FALSE(rollout->episode.success);
  EXPECT_EQ(rollout->episode.steps(), 120);
  EXPECT_EQ(asked, 8) << "one question every 15 steps";
  EXPECT_TRUE(rollout->episode.cameras[0].streams.empty());
}

// A policy without memory that rises a little before it comes down, in each answer: asked again on the way up, it comes
// down in none of them.
TEST(Rollout, AnswersThatLeadNowhereAreFollowedToTheirEnd) {
  CampaignSpec spec = RolloutSpecOf("pick");
  spec.rollout.latency_ms = 0;
  auto runner = AttemptRunner::Open(spec);
  ASSERT_TRUE(runner.has_value()) << runner.error().message;
  double lowest = 1;
  const Eigen::Vector3d above{-0.11, 0.25, 0.25};
  const auto rollout = runner->Rollout(0, [&](const policy::Question&) {
    policy::Answer answer = Stay(above);
    for (int k = 0; k < kWaypoints; ++k)
      answer.waypoints[k].X_WE.p.z() += WaypointStep(k) < 40 ? 0.01 : -0.01 * (k - 4);
    return answer;
  });
  ASSERT_TRUE(rollout.has_value()) << rollout.error().message;
  const Episode& episode = rollout->episode;
  for (int t = 0; t < episode.steps(); ++t) lowest = std::min<double>(lowest, episode.eef_pos.row(t)[2]);
  EXPECT_LT(lowest, above.z() - 0.05);
  const auto& decisions = episode.details["decisions"];
  int followed = 0;
  for (std::size_t k = 1; k < decisions.size(); ++k)
    followed += decisions[k]["step"].get<int>() - decisions[k - 1]["step"].get<int>() == kHorizonSteps;
  EXPECT_GE(followed, 1);
  EXPECT_LE(followed, spec.rollout.max_steps / 300) << "and then it is asked as before";
}

TEST(Rollout, AsTheAuthorsHoldsOnePoseOfEachAnswerForTheirTime) {
  CampaignSpec spec = RolloutSpecOf("pick");
  spec.rollout.execution = "authors";
  spec.rollout.record = false;
  auto runner = AttemptRunner::Open(spec);
  ASSERT_TRUE(runner.has_value()) << runner.error().message;
  int asked = 0;
  const auto rollout = runner->Rollout(0, [&](const policy::Question&) -> Result<policy::Answer> {
    // two places in turn: what is held changes with each answer and not between them
    return Stay({-0.11, ++asked % 2 ? 0.13 : 0.16, 0.2});
  });
  ASSERT_TRUE(rollout.has_value()) << rollout.error().message;
  EXPECT_EQ(asked, 67);
  EXPECT_EQ(rollout->episode.steps(), 67 * 45);
  EXPECT_EQ(rollout->outcome, AttemptOutcome::kTimeout);
  const auto& wanted = rollout->episode.actions_abs;
  for (int step = 1; step < 4 * 45; ++step)
    EXPECT_EQ(wanted.row(step)[1] != wanted.row(step - 1)[1], step % 45 == 0) << step;
}

// Steps before the hand was first commanded to move, and questions in 120 steps.
std::pair<int, int> Delay(double latency_ms, double server_p99_ms) {
  CampaignSpec spec = RolloutSpecOf("pick");
  spec.rollout.replan_steps = 15;
  spec.rollout.max_steps = 120;
  spec.rollout.record = false;
  spec.rollout.latency_ms = latency_ms;
  auto runner = AttemptRunner::Open(spec);
  int asked = 0;
  const auto rollout = runner->Rollout(0, [&](const policy::Question&) {
    ++asked;
    policy::Answer answer = Stay({-0.3, 0.1, 0.3});
    answer.server_p99_ms = server_p99_ms;
    return answer;
  });
  const Track& commands = rollout->episode.actions_abs;
  int still = 0;
  while (commands.row(still)[0] == commands.row(0)[0] && commands.row(still)[2] == commands.row(0)[2]) ++still;
  // the command of step 0 is a moving one already when there is no latency
  const auto hand = rollout->episode.eef_pos.row(0);
  if (std::abs(hand[0] - commands.row(0)[0]) + std::abs(hand[2] - commands.row(0)[2]) > 1e-4) still = 0;
  EXPECT_EQ(rollout->episode.details["latency_steps"].get<int>(), still);
  return {still, asked};
}

TEST(Rollout, TheSimulationRunsOnUntilTheAnswerTakesEffect) {
  EXPECT_EQ(Delay(0, 100), std::pair(0, 8)) << "set to none, whatever the server needs";
  EXPECT_EQ(Delay(16, 0), std::pair(2, 8));
  EXPECT_EQ(Delay(17, 0), std::pair(3, 8)) << "rounded up to control steps";
  EXPECT_EQ(Delay(-1, 17), std::pair(3, 8)) << "what the server measured";
  EXPECT_EQ(Delay(-1, 0), std::pair(0, 8)) << "it has not measured";
  EXPECT_EQ(Delay(200, 0), std::pair(25, 5)) << "the next question waits for the answer";
}

TEST(Rollout, RefusesGarbage) {
  auto runner = AttemptRunner::Open(RolloutSpecOf("pick"));
  ASSERT_TRUE(runner.has_value()) << runner.error().message;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  policy::Answer bad = Stay({0, 0.2, 0.2});
  bad.waypoints[5].X_WE.p.x() = nan;
  for (const policy::Answer& answer : {bad, policy::Answer{}, Stay({0, 400, 0})}) {
    const auto rollout = runner->Rollout(1, [&](const policy::Question&) { return answer; });
    ASSERT_TRUE(rollout.has_value());
    EXPECT_EQ(rollout->outcome, AttemptOutcome::kPolicyError);
    EXPECT_FALSE(rollout->reason.empty());
    EXPECT_EQ(rollout->episode.outcome, "policy_error");
    // before, it had no step: a collector refused it, and no evaluation with such an answer came to its end
    const auto sent = DecodeEpisode(EncodeEpisode(rollout->episode));
    ASSERT_TRUE(sent) << sent.error().message;
    EXPECT_EQ(sent->steps(), 1);
  }
}

// an answer that the policy cannot give ends its rollout as one that cannot be followed does; a policy that is away
// ends none
TEST(Rollout, EndsWhereThePolicyHasNoAnswerAndNotWhereNobodyAnswers) {
  auto runner = AttemptRunner::Open(RolloutSpecOf("pick"));
  ASSERT_TRUE(runner.has_value()) << runner.error().message;
  const auto roll_out = [&](Code code) {
    return runner->Rollout(1, [&](const policy::Question&) { return Fail(code, "its answer is not finite"); });
  };
  const auto none = roll_out(Code::kCorrupt);
  ASSERT_TRUE(none.has_value()) << none.error().message;
  EXPECT_EQ(none->outcome, AttemptOutcome::kPolicyError);
  EXPECT_NE(none->reason.find("its answer is not finite"), std::string::npos) << none->reason;
  EXPECT_EQ(none->episode.steps(), 1);
  const auto away = roll_out(Code::kUnavailable);
  ASSERT_FALSE(away.has_value());
  EXPECT_EQ(away.error().code, Code::kUnavailable);
}

struct Seen {
  Episode episode;
  std::vector<std::vector<std::uint8_t>> asked;  // pictures of questions
};

Seen LookOn(double occlude) {
  CampaignSpec spec = RolloutSpecOf("pick");
  spec.camera.width = spec.camera.height = 224;
  spec.image_stride = spec.rollout.replan_steps = 15;
  spec.rollout.max_steps = 60;
  spec.rollout.occlude = occlude;
  auto runner = AttemptRunner::Open(spec);
  Seen seen;
  auto rollout = runner->Rollout(0, [&](const policy::Question& question) {
    seen.asked.emplace_back(question.rgb.begin(), question.rgb.end());
    return Stay({-0.11, 0.13, 0.2});
  });
  seen.episode = std::move(rollout->episode);
  return seen;
}

TEST(Rollout, WhatIsOccludedIsWhatThePolicySeesAndWhatIsRecorded) {
  const Seen plain = LookOn(0), occluded = LookOn(0.42), again = LookOn(0.42);
  EXPECT_FALSE(plain.episode.details.contains("occlusion"));
  EXPECT_EQ(EncodeEpisode(occluded.episode), EncodeEpisode(again.episode));
  EXPECT_NEAR(occluded.episode.details["occlusion"]["covered"].get<double>(), 0.42, 0.03);
  EXPECT_EQ(occluded.episode.states.values, plain.episode.states.values) << "the world is the same";
  ASSERT_EQ(occluded.asked.size(), 4u);
  FrameCursor frames(occluded.episode);
  ASSERT_EQ(frames.size(), 4u);
  for (std::size_t k = 0; k < 4; ++k) {
    const auto recorded = frames.Frame(k);
    ASSERT_THAT(recorded, IsOk());
    const std::vector<std::uint8_t> frame(recorded->begin(), recorded->end());
    EXPECT_EQ(frame, occluded.asked[k]);
    EXPECT_NE(occluded.asked[k], plain.asked[k]);
    std::size_t changed = 0;
    for (std::size_t i = 0; i < frame.size(); i += 3)
      if (!std::equal(&frame[i], &frame[i] + 3, &plain.asked[k][i])) {
        ++changed;
        EXPECT_EQ(frame[i] + frame[i + 1] + frame[i + 2], 3 * 128) << "grey";
      }
    EXPECT_LT(changed, 8u * 64) << "a few blocks";
  }
}

TEST(Rollout, SaysTheSentenceThatIsWrittenDown) {
  CampaignSpec spec = RolloutSpecOf("pick");
  spec.rollout.max_steps = 15;
  spec.rollout.sentences = {{"Fetch the fizz!", "pick", "coke", ""}, {"fetch the loaf", "pick", "bread", ""}};
  auto runner = AttemptRunner::Open(spec);
  ASSERT_TRUE(runner.has_value()) << runner.error().message;
  for (std::uint64_t index = 0; index < 3; ++index) {
    const SentenceSpec& sentence = spec.rollout.sentences[index % 2];
    const auto rollout = runner->Rollout(index, [&](const policy::Question& question) {
      EXPECT_EQ(question.instruction, sentence.text);
      return Stay({-0.11, 0.13, 0.2});
    });
    ASSERT_TRUE(rollout.has_value());
    EXPECT_EQ(rollout->episode.instruction, sentence.text);
    EXPECT_EQ(rollout->episode.target, sentence.object);
  }
}

TEST(Rollout, HandsThePolicysErrorOn) {
  auto runner = AttemptRunner::Open(RolloutSpecOf("pick"));
  ASSERT_TRUE(runner.has_value()) << runner.error().message;
  const auto rollout = runner->Rollout(
      1, [](const policy::Question&) -> Result<policy::Answer> { return Fail(Code::kTimeout, "no one"); });
  ASSERT_FALSE(rollout.has_value());
  EXPECT_EQ(rollout.error().code, Code::kTimeout);
}

}  // namespace rollout_test
}  // namespace etude::task
