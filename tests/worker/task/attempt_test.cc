// SPDX-License-Identifier: Apache-2.0
#include "worker/task/attempt.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <set>

#include "services/episode/codec.h"
#include "services/episode/frame_cursor.h"
#include "tests/support/matchers.h"
#include "tests/support/replace_in_file.h"
#include "tests/support/sketch_robot.h"
#include "tests/support/temporary_folder.h"

namespace etude::task {
namespace attempt_test {

CampaignSpec QuickSpec(const std::string& task) {
  CampaignSpec spec;
  spec.tasks = {task};
  spec.seed = 20;
  spec.image_stride = 125;  // the pictures cost more than everything else
  spec.camera.width = spec.camera.height = 64;
  return spec;
}

AttemptRunner OpenOrDie(const CampaignSpec& spec) {
  auto runner = AttemptRunner::Open(spec);
  if (!runner) ADD_FAILURE() << runner.error().message;
  return std::move(runner).value();
}

// First success of `index`, as a campaign would retry.
AttemptResult FirstSuccess(AttemptRunner& runner, std::uint64_t index) {
  AttemptResult result;
  for (std::uint32_t attempt = 0; attempt < 5; ++attempt) {
    result = runner.Demonstrate(index, attempt).value();
    if (result.outcome == AttemptOutcome::kSuccess) break;
  }
  return result;
}

class Demonstrate : public testing::TestWithParam<const char*> {};

TEST_P(Demonstrate, SucceedsOnSeededScenes) {
  AttemptRunner runner = OpenOrDie(QuickSpec(GetParam()));
  int successes = 0;
  const int scenes = 12;
  for (int index = 0; index < scenes; ++index) {
    const auto result = runner.Demonstrate(index, 0).value();
    successes += result.outcome == AttemptOutcome::kSuccess;
    if (result.outcome != AttemptOutcome::kSuccess) {
      EXPECT_FALSE(result.reason.empty());
      EXPECT_EQ(result.failure["point"].size(), 3u);
      EXPECT_TRUE(result.failure["stage"].is_string() && result.failure["pair"].is_string());
      EXPECT_EQ(result.episode.steps(), 0) << "a failed attempt is no episode";
    }
  }
  EXPECT_GE(successes, scenes - 1);
}

// Scenes whose ball stands where the thumb of a hand that still closes would touch it. In the second one friction keeps
// the hand 15 mm from the push's goal, which is far enough.
TEST(Expert, ClosesTheHandBeforeOpenFingersWouldTouchSomething) {
  CampaignSpec spec = QuickSpec("push+obstacle");
  spec.robots = {"jaco2"};
  spec.seed = 1;
  AttemptRunner runner = OpenOrDie(spec);
  for (const std::uint64_t index : {29, 127, 165}) {
    const auto result = runner.Demonstrate(index, 0).value();
    ASSERT_EQ(result.outcome, AttemptOutcome::kSuccess) << index << ": " << result.reason;
    const Episode& episode = result.episode;
    const auto hand = [&](int step) { return Eigen::Map<const Eigen::Vector3f>(episode.eef_pos.row(step).data()); };
    int closed = 0;
    while (closed < episode.steps() && episode.gripper_qpos.row(closed)[0] < 0.8 * episode.gripper_qpos.row(200)[0])
      ++closed;
    EXPECT_GT(closed, 20) << index;
    EXPECT_LT((hand(closed) - hand(0)).norm(), 0.005) << index << ": it set off with open fingers";
  }
}

TEST_P(Demonstrate, RecordsEveryTrackAtTheControlRate) {
  const CampaignSpec spec = QuickSpec(GetParam());
  AttemptRunner runner = OpenOrDie(spec);
  const auto result = FirstSuccess(runner, 3);
  ASSERT_EQ(result.outcome, AttemptOutcome::kSuccess) << result.reason;
  const Episode& episode = result.episode;
  const int T = episode.steps();
  ASSERT_GT(T, 60);
  for (const Track* track : {&episode.joint_pos, &episode.joint_vel, &episode.gripper_qpos, &episode.eef_pos,
                             &episode.eef_quat, &episode.eef_pixel, &episode.actions_abs, &episode.states})
    EXPECT_EQ(track->rows(), T);
  EXPECT_EQ(static_cast<int>(episode.phase.size()), T);
  EXPECT_EQ(static_cast<int>(episode.supervise.size()), T);
  ASSERT_EQ(episode.cameras.size(), 1u);
  FrameCursor frames(episode);
  ASSERT_EQ(static_cast<int>(frames.size()), (T + spec.image_stride - 1) / spec.image_stride);
  const auto last = frames.Frame(frames.size() - 1);
  ASSERT_TRUE(last);
  EXPECT_TRUE(std::ranges::any_of(*last, [](std::uint8_t byte) { return byte != 0; })) << "no frame is missing";
  EXPECT_EQ(episode.objects.size(), spec.objects.size());
  EXPECT_NE(episode.FindObject(episode.target), nullptr);
  EXPECT_TRUE(episode.success);
  EXPECT_FALSE(episode.instruction.empty());
  EXPECT_EQ(episode.task, GetParam());
  EXPECT_EQ(episode.spec_sha256, SpecHash(spec));
  // every stage was played, in the order of its first step
  std::vector<int> order;
  for (auto phase : episode.phase)
    if (std::find(order.begin(), order.end(), phase) == order.end()) order.push_back(phase);
  EXPECT_EQ(order.size(), episode.stage_names.size());
}

TEST_P(Demonstrate, CommandsAreSmoothWhereTheyAreSupervised) {
  AttemptRunner runner = OpenOrDie(QuickSpec(GetParam()));
  const auto result = FirstSuccess(runner, 1);
  ASSERT_EQ(result.outcome, AttemptOutcome::kSuccess) << result.reason;
  const Track& actions = result.episode.actions_abs;
  int compared = 0;
  for (int t = 1; t < actions.rows(); ++t) {
    Eigen::Vector3d step;
    for (int i = 0; i < 3; ++i) step[i] = actions.row(t)[i] - actions.row(t - 1)[i];
    const auto& supervise = result.episode.supervise;
    if (!supervise[t] || !supervise[t - 1]) continue;  // a disturbance jerks, on purpose
    EXPECT_LT(step.norm() * kControlRate, 1.0) << t;
    ++compared;
  }
  EXPECT_GT(compared, actions.rows() / 2);
}

TEST_P(Demonstrate, IsAPureFunctionOfSpecIndexAndAttempt) {
  const CampaignSpec spec = QuickSpec(GetParam());
  AttemptRunner runner = OpenOrDie(spec);
  const auto first = FirstSuccess(runner, 5);
  ASSERT_EQ(first.outcome, AttemptOutcome::kSuccess) << first.reason;
  const std::uint32_t attempt = first.episode.attempt;
  const auto bytes = EncodeEpisode(first.episode);
  ASSERT_TRUE(runner.Demonstrate(9, 0));  // something else in between
  EXPECT_EQ(EncodeEpisode(runner.Demonstrate(5, attempt).value().episode), bytes);
  AttemptRunner fresh = OpenOrDie(spec);
  EXPECT_EQ(EncodeEpisode(fresh.Demonstrate(5, attempt).value().episode), bytes);
}

INSTANTIATE_TEST_SUITE_P(Tasks, Demonstrate, testing::Values("pick", "push", "put_down"),
                         [](const auto& info) { return std::string(info.param); });

TEST(Attempt, DisturbancesAreMarkedAndRecoveredFrom) {
  CampaignSpec spec = QuickSpec("pick");
  spec.randomization.disturbance_probability = 1;
  AttemptRunner runner = OpenOrDie(spec);
  int pushed = 0, successes = 0;
  for (int index = 0; index < 6; ++index) {
    const auto result = runner.Demonstrate(index, 0).value();
    if (result.outcome != AttemptOutcome::kSuccess) continue;
    ++successes;
    const auto& supervise = result.episode.supervise;
    const auto off = std::count(supervise.begin(), supervise.end(), 0);
    const int pushes = result.episode.details["pushes"].get<int>();
    EXPECT_GE(off, 20 * pushes);
    EXPECT_LE(off, 30 * pushes);
    pushed += pushes;
  }
  EXPECT_GE(successes, 5);
  EXPECT_GE(pushed, 6);
}

TEST(Attempt, WithoutDisturbancesEveryStepIsSupervised) {
  CampaignSpec spec = QuickSpec("push");
  spec.randomization.disturbance_probability = 0;
  AttemptRunner runner = OpenOrDie(spec);
  const auto result = FirstSuccess(runner, 2);
  ASSERT_EQ(result.outcome, AttemptOutcome::kSuccess) << result.reason;
  EXPECT_THAT(result.episode.supervise, testing::Each(1));
}

TEST(Attempt, SaysHowFarItIs) {
  AttemptRunner runner = OpenOrDie(QuickSpec("pick"));
  std::vector<std::string> stages;
  int steps = 0, starts = 0;
  runner.OnProgress([&](std::string_view stage, int step) {
    if (stage == "start") {
      EXPECT_EQ(step, starts++);
      EXPECT_EQ(steps, 0);
      return;
    }
    EXPECT_EQ(step, steps);
    steps = step + 1;
    if (stages.empty() || stages.back() != stage) stages.emplace_back(stage);
  });
  const auto result = runner.Demonstrate(0, 0).value();
  runner.OnProgress(nullptr);
  ASSERT_EQ(result.outcome, AttemptOutcome::kSuccess) << result.reason;
  EXPECT_EQ(starts, result.scene.at("draws").get<int>());
  EXPECT_EQ(steps, result.episode.steps());
  EXPECT_GT(stages.size(), 2u);
  for (const auto& stage : stages) EXPECT_EQ(std::ranges::count(result.episode.stage_names, stage), 1) << stage;
}

TEST(Attempt, RefusesABadSpec) {
  CampaignSpec spec;
  spec.robots = {"ur6"};
  const auto runner = AttemptRunner::Open(spec);
  ASSERT_FALSE(runner.has_value());
  EXPECT_EQ(runner.error().code, Code::kInvalidArgument);
}

// before, every draw ended without the object, and so did every attempt
TEST(Attempt, RefusesAStartRuleAboutTheBallThatIsPlacedAfterTheObjects) {
  const TemporaryFolder folder;
  const std::string mine = (folder / "roll.yaml").string();
  std::filesystem::copy_file("deploy/tasks/push.yaml", mine);
  ReplaceInFile(mine, "start:\n", "start:\n  not_already: {risen: {object: basketball}}\n");
  const std::string task = mine + "+obstacle";
  const auto runner = AttemptRunner::Open(QuickSpec(task));
  EXPECT_THAT(runner, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(runner, MessageHas("task '" + task +
                                 "': start.not_already speaks of the basketball, which is placed after the objects"));
}

TEST(Show, SetsTheSceneThatTheDemonstrationStartsFrom) {
  const CampaignSpec spec = QuickSpec("pick");
  AttemptRunner runner = OpenOrDie(spec);
  const auto scene = runner.Show(3, 0);
  ASSERT_TRUE(scene) << scene.error().message;
  std::vector<std::uint8_t> shown(64 * 64 * 3);
  scene->renderer->Render(*scene->world, shown);
  const std::vector<float> state = scene->world->StateVector();

  const auto result = runner.Demonstrate(3, 0).value();
  ASSERT_EQ(result.outcome, AttemptOutcome::kSuccess) << result.reason;
  EXPECT_EQ(scene->instruction, result.episode.instruction);
  EXPECT_TRUE(std::equal(state.begin(), state.end(), result.episode.states.row(0).begin()));
}

// a hand was turned about any axis, which five joints cannot: their datasets had no recoveries, without a word
TEST(Expert, PushesAnArmOfFiveJoints) {
  SketchRobot sketch;
  sketch.WithoutRoll();
  CampaignSpec spec = QuickSpec("pick");
  spec.robots = {sketch.yaml()};
  spec.objects = {"cube"};
  spec.randomization.disturbance_probability = 1;
  AttemptRunner runner = OpenOrDie(spec);
  int pushes = 0;
  for (int index = 0; index < 6; ++index)
    pushes += runner.Demonstrate(index, 0).value().episode.details.value("pushes", 0);
  EXPECT_GE(pushes, 4);
}

// its fingers hear of the grasp 40 steps after it was said, and need 50 for a can
TEST(Expert, WaitsForFingersThatHearLate) {
  CampaignSpec spec = QuickSpec("pick");
  spec.robots = {"panda"};
  spec.objects = {"cube"};
  spec.world.control_delay = 40;
  spec.randomization.disturbance_probability = 0;
  AttemptRunner runner = OpenOrDie(spec);
  const auto result = FirstSuccess(runner, 0);
  EXPECT_EQ(result.outcome, AttemptOutcome::kSuccess) << result.reason;
}

}  // namespace attempt_test
}  // namespace etude::task
