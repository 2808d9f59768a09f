// SPDX-License-Identifier: Apache-2.0
// Seeded demonstrations of every kind of task with every robot, one of each judged again from its record.
#include <gmock/gmock.h>

#include <algorithm>
#include <map>
#include <numbers>

#include "services/core/check.h"
#include "services/spec/task_name.h"
#include "tests/worker/task/largest_turn.h"
#include "tests/worker/task/relations.h"
#include "worker/task/attempt.h"

namespace etude::task {
namespace robots_tasks_test {

CampaignSpec SpecFor(const std::string& robot) {
  CampaignSpec spec;
  spec.robots = {robot};
  spec.tasks = {"pick",          "push",          "put_down",          "rotate",
                "place_left",    "place_right",   "place_front",       "place_behind",
                "pick+obstacle", "push+obstacle", "put_down+obstacle", "rotate+obstacle",
                "pick+others",   "push+others",   "put_down+others",   "rotate+others"};
  spec.objects = {"coke", "milk", "cube", "bottle"};
  spec.seed = 40;
  spec.image_stride = 125;
  spec.camera.width = spec.camera.height = 32;
  return spec;
}

Pose PoseAt(const ObjectTrack& object, int t) {
  const auto row = object.pose.row(t);
  return {{row[0], row[1], row[2]}, Eigen::Quaterniond(row[3], row[4], row[5], row[6]).normalized()};
}

// How far `object` was from where it started, at most, m.
double Moved(const ObjectTrack& object) {
  double most = 0;
  for (int t = 0; t < object.pose.rows(); ++t)
    most = std::max(most, (PoseAt(object, t).p - PoseAt(object, 0).p).norm());
  return most;
}

// The task's claim, from the poses alone.
void JudgeAgain(const Episode& episode, const std::string& target, const std::string& reference) {
  const TaskName task = ParseTask(episode.task).value();
  const ObjectTrack* object = episode.FindObject(target);
  ASSERT_NE(object, nullptr);
  const int last = object->pose.rows() - 1;
  const Pose start = PoseAt(*object, 0), end = PoseAt(*object, last);
  if (task.base == "rotate") {
    EXPECT_LT(TurnError(end, start, std::numbers::pi / 2), 0.5);
    EXPECT_GT(end.p.z(), 0.08);
  }
  if (task.relation()) {
    const ObjectTrack* other = episode.FindObject(reference);
    ASSERT_NE(other, nullptr);
    EXPECT_FALSE(IsBeside(task.base, start.p, PoseAt(*other, 0).p));
    EXPECT_TRUE(IsBeside(task.base, end.p, PoseAt(*other, last).p));
    EXPECT_EQ(episode.reference, reference);
  }
  if (task.base == "pick") {
    EXPECT_GT(end.p.z() - start.p.z(), 0.03);
  }
  if (task.base == "push") {
    EXPECT_GT(end.p.y() - start.p.y(), 0.03);
  }
  if (task.base == "put_down") {
    EXPECT_NEAR(TiltOf(end), std::numbers::pi / 2, 0.7);
  }
  for (const auto& other : episode.objects) {
    const bool avoided = task.avoid == "others" || (task.avoid == "obstacle" && other.name == kObstacleObject);
    if (!avoided || other.name == target) continue;
    EXPECT_LT(Moved(other), 0.01) << other.name << " was touched";
  }
}

class EveryTask : public testing::TestWithParam<const char*> {};

TEST_P(EveryTask, IsDemonstratedByTheRobot) {
  const CampaignSpec spec = SpecFor(GetParam());
  auto runner = AttemptRunner::Open(spec);
  ASSERT_TRUE(runner) << runner.error().message;
  for (std::uint64_t index = 0; index < spec.tasks.size(); ++index) {
    const EpisodePlan plan = PlanEpisode(spec, index, 0);
    const std::string task = plan.task.text();
    SCOPED_TRACE(task);
    AttemptResult result;
    std::string reasons;
    for (std::uint32_t attempt = 0; attempt < 4; ++attempt) {
      result = runner->Demonstrate(index, attempt).value();
      if (result.outcome == AttemptOutcome::kSuccess) break;
      reasons += std::string(ToString(result.outcome)) + " (" + result.reason + "); ";
    }
    EXPECT_EQ(result.outcome, AttemptOutcome::kSuccess) << reasons;
    if (result.outcome != AttemptOutcome::kSuccess) continue;
    EXPECT_EQ(result.episode.robot, GetParam());
    EXPECT_EQ(result.episode.task, task);
    EXPECT_EQ(result.episode.joint_pos.columns, GetParam() == std::string("panda") ? 7 : 6);
    EXPECT_LE(LargestTurn(result.episode), 0.05) << "labels jump";
    EXPECT_TRUE(result.episode.details["success_latched"].get<bool>()) << "success implies it";
    EXPECT_TRUE(result.episode.details["violations"].empty());
    JudgeAgain(result.episode, plan.target, plan.reference);
  }
}

// Other scenes of every task, an attempt each: whatever is kept of them must be fit to learn from.
TEST_P(EveryTask, HasLabelsWithoutJumpsInMoreThanOneScene) {
  const CampaignSpec spec = SpecFor(GetParam());
  auto runner = AttemptRunner::Open(spec);
  ASSERT_TRUE(runner) << runner.error().message;
  const std::uint64_t tasks = spec.tasks.size();
  std::uint64_t kept = 0;
  for (std::uint64_t index = tasks; index < 2 * tasks; ++index) {
    const AttemptResult result = runner->Demonstrate(index, 0).value();
    if (result.outcome != AttemptOutcome::kSuccess) continue;
    ++kept;
    EXPECT_LE(LargestTurn(result.episode), 0.05) << result.episode.task << " of scene " << index;
  }
  EXPECT_GT(kept, tasks / 2);
}

// Tasks that are files alone (deploy/tasks), with the objects of their campaigns.
class TaskOfAFile : public testing::TestWithParam<const char*> {};

TEST_P(TaskOfAFile, IsDemonstratedWithoutJumps) {
  CampaignSpec spec = SpecFor("ur5");
  spec.tasks = {GetParam()};
  spec.objects = CampaignSpec().objects;
  if (spec.tasks.front() == "drop_in") spec.objects = {"cube", "coke", "pepsi", "milk", "open_box"};
  auto runner = AttemptRunner::Open(spec);
  ASSERT_TRUE(runner) << runner.error().message;
  constexpr int kScenes = 5;
  int successes = 0;
  for (int index = 0; index < kScenes; ++index) {
    const AttemptResult result = runner->Demonstrate(index, 0).value();
    if (result.outcome != AttemptOutcome::kSuccess) continue;
    ++successes;
    EXPECT_EQ(result.episode.task, GetParam());
    EXPECT_LE(LargestTurn(result.episode), 0.05) << "labels jump in scene " << index;
  }
  EXPECT_GE(successes, kScenes - 1);
}

INSTANTIATE_TEST_SUITE_P(Files, TaskOfAFile, testing::Values("stack", "drop_in"),
                         [](const auto& info) { return std::string(info.param); });

INSTANTIATE_TEST_SUITE_P(Robots, EveryTask, testing::Values("ur5", "panda", "jaco2"),
                         [](const auto& info) { return std::string(info.param); });

}  // namespace robots_tasks_test
}  // namespace etude::task
