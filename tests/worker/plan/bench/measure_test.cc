// SPDX-License-Identifier: Apache-2.0
// Tests worker/plan/bench/measure.cc, worker/plan/bench/plain_rrt.cc and worker/plan/bench/scenes.cc
#include "worker/plan/bench/measure.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>

#include "services/core/stop.h"
#include "tests/worker/sim/scene_fixture.h"
#include "worker/plan/bench/plain_rrt.h"

namespace etude::plan {
namespace measure_test {

TEST(PlanningScene, IsAFunctionOfSeedAndIndexAndFreeAtBothEnds) {
  const auto scene = sim::FullScene();
  sim::Kinematics kinematics(scene);
  collide::Checker checker(scene), other_checker(scene);
  for (const Difficulty difficulty : kDifficulties) {
    Eigen::Vector3d before = Eigen::Vector3d::Zero();
    for (int index = 0; index < 10; ++index) {
      const auto planning = DrawPlanningScene(*scene, difficulty, 3, index, kinematics, checker);
      ASSERT_TRUE(planning) << ToString(difficulty) << " " << index;
      const auto again = DrawPlanningScene(*scene, difficulty, 3, index, kinematics, other_checker);
      ASSERT_TRUE(again);
      EXPECT_EQ(again->q_start, planning->q_start);
      EXPECT_EQ(again->X_WE_goal.p, planning->X_WE_goal.p);
      EXPECT_NE(planning->X_WE_goal.p, before);
      before = planning->X_WE_goal.p;

      Place(*scene, *planning, checker);
      EXPECT_FALSE(checker.Check(planning->q_start, 0.004));
      const auto q_goal = kinematics.Solve(planning->X_WE_goal, planning->q_start);
      ASSERT_TRUE(q_goal);
      EXPECT_FALSE(checker.Check(*q_goal, 0.004));
      EXPECT_EQ(planning->objects.size() > 2, difficulty != Difficulty::kOpen);
    }
  }
}

// before, only a second Ctrl-C ended it
TEST(RunBench, EndsWhenItIsAskedTo) {
  const auto stopped = [] {  // in a process of its own: a request stays
    BenchOptions options;
    options.scenes = 3;
    options.difficulties = {"open"};
    options.planners = {options.planners.front()};
    const auto rows = RunBench(options, [](int, int) { RequestStop(); });
    std::fputs(rows ? "went on" : rows.error().message.c_str(), stderr);
    std::_Exit(7);
  };
  EXPECT_EXIT(stopped(), testing::ExitedWithCode(7), "stopped after 1 of 3 scenes");
}

TEST(RunBench, SolvesEasyScenesWithEveryPlannerAndSaysWhatTheyTook) {
  BenchOptions options;
  options.scenes = 3;
  options.difficulties = {"open"};
  options.deadline_s = 60;  // a slow machine is no failure here
  int calls = 0;
  const auto rows = RunBench(options, [&](int done, int all) {
    EXPECT_EQ(done, ++calls);
    EXPECT_EQ(all, 3);
  });
  ASSERT_TRUE(rows) << rows.error().message;
  ASSERT_EQ(rows->size(), 3u);
  EXPECT_EQ(calls, 3);
  for (const BenchRow& row : *rows) {
    EXPECT_EQ(row.scenes, 3);
    EXPECT_EQ(row.solved, 3) << row.planner;
    EXPECT_EQ(row.in_contact, 0);
    EXPECT_GT(row.plan_ms, 0);
    EXPECT_GE(row.total_p95_ms, row.total_ms);
    EXPECT_GT(row.tool_m, 0.1);
    EXPECT_GT(row.joint_rad, 0.1);
    EXPECT_GT(row.clearance_mm, 1);
    EXPECT_EQ(row.Json()["planner"], row.planner);
    EXPECT_NE(BenchTable(*rows).find(row.planner), std::string::npos);
  }
}

TEST(RunBench, NamesWhatItDoesNotKnow) {
  BenchOptions options;
  options.planners = {"teleport"};
  auto rows = RunBench(options, [](int, int) {});
  ASSERT_FALSE(rows);
  EXPECT_NE(rows.error().message.find("teleport"), std::string::npos);
  options = {};
  options.difficulties = {"impossible"};
  rows = RunBench(options, [](int, int) {});
  ASSERT_FALSE(rows);
  EXPECT_NE(rows.error().message.find("open, cluttered or narrow"), std::string::npos);
}

TEST(PlainRrt, FindsPathsAndStopsAtItsDeadline) {
  const auto scene = sim::FullScene();
  sim::Kinematics kinematics(scene);
  collide::Checker checker(scene);
  const auto planning = DrawPlanningScene(*scene, Difficulty::kOpen, 4, 0, kinematics, checker);
  ASSERT_TRUE(planning);
  Place(*scene, *planning, checker);
  Request request;
  request.q_start = planning->q_start;
  request.X_WE_goal = planning->X_WE_goal;
  PlainRrt plain(scene, 1);
  const Outcome outcome = plain.Plan(request, checker, 60);
  EXPECT_EQ(outcome.kind, OutcomeKind::kSampled);
  EXPECT_EQ(outcome.motion.X_WE.back().p, request.X_WE_goal.p);
  EXPECT_EQ(plain.Plan(request, checker, 0).kind, OutcomeKind::kNoPath);
}

}  // namespace measure_test
}  // namespace etude::plan
