// SPDX-License-Identifier: Apache-2.0
#include "worker/task/task_stages.h"

#include <gmock/gmock.h>

#include <memory>
#include <numbers>
#include <set>

#include "tests/worker/task/stages_fixture.h"
#include "worker/task/criteria.h"

namespace etude::task {
namespace task_stages_test {

struct Fixture {
  Fixture() {
    auto built = sim::Scene::Build(SceneSpec{});
    EXPECT_TRUE(built.has_value()) << built.error().message;
    scene = *built;
    kinematics.emplace(scene);
    shapes.emplace(*scene, *kinematics);
    now = {.shapes = &*shapes,
           .target = "coke",
           .X_WO = {{0.1, 0.3, shapes->object("coke").rest_height}, Eigen::Quaterniond::Identity()},
           .X_WE = {{-0.1, 0.13, 0.08}, LevelHand()}};
  }
  std::shared_ptr<const sim::Scene> scene;
  std::optional<sim::Kinematics> kinematics;
  std::optional<SceneGeometry> shapes;
  StageContext now;
};

TEST(StagesOf, EndWithAWaitAndGripAsTheyShould) {
  const Fixture f;
  for (const std::string& name : KnownTasks()) {
    const TaskName task = *ParseTask(name);
    const auto stages = StagesOf(task, *f.shapes);
    EXPECT_FALSE(stages.back().moves()) << name;
    EXPECT_FALSE(stages.back().blends) << name;
    for (const auto& stage : stages)
      EXPECT_TRUE(!stage.holds || (stage.closed && stage.touches_target)) << name << stage.name;
  }
}

// before, a hand that was pushed aside reached from where the push had left it
TEST(StagesOf, GoBackToAlignAgainAcrossAWait) {
  const Fixture f;
  TaskName task = *ParseTask("pick");
  EXPECT_EQ(StagesOf(task, *f.shapes).at(1).back_to, 1) << "approach, reach";
  auto waits = std::make_shared<TaskSpec>(*task.spec);
  waits->stages.insert(waits->stages.begin() + 1, HoldSpec{});
  task.spec = waits;
  EXPECT_EQ(StagesOf(task, *f.shapes).at(2).back_to, 2) << "approach, hold, reach";
}

TEST(StagesOf, KeepTheClearanceThatIsWishedOfWhatIsAvoidedAlone) {
  const Fixture f;
  const auto clearances = [&](const char* task, double wished) {
    std::set<double> found;
    for (const auto& stage : StagesOf(*ParseTask(task), *f.shapes, wished))
      if (stage.moves() && !stage.straight_only) found.insert(stage.clearance);
    return found;
  };
  EXPECT_EQ(clearances("pick+obstacle", 0.08), std::set<double>{0.08});
  EXPECT_EQ(clearances("pick+others", 0.08), std::set<double>{0.08});
  EXPECT_EQ(clearances("pick", 0.08), std::set<double>{0});
}

TEST(SceneGeometry, HandIsLevelAtHomeAndMeasured) {
  Fixture f;
  const Pose home = f.kinematics->X_WE(f.scene->arm().q_home);
  EXPECT_LT(AngleBetween(home.q, LevelHand()), 0.15);
  EXPECT_GT(f.shapes->ahead_open(), -0.05);
  EXPECT_LT(f.shapes->ahead_open(), 0.06);
}

TEST(SceneGeometry, HeightOnTableIsTheRestHeightWhenUpright) {
  Fixture f;
  for (const auto& object : f.scene->objects()) {
    EXPECT_NEAR(f.shapes->HeightOnTable(object.name, Eigen::Quaterniond::Identity()), object.rest_height, 2e-3)
        << object.name;
    const double lying = f.shapes->HeightOnTable(object.name, FromEuler({-std::numbers::pi / 2, 0, 0}));
    EXPECT_NEAR(lying, object.half_extent.y(), 4e-3) << object.name;
  }
}

TEST(Stages, ReachPutsTheTipsJustBeyondTheAxis) {
  Fixture f;
  const auto stages = StagesOf(*ParseTask("pick"), *f.shapes);
  const Pose goal = FindStage(stages, "reach").goal(f.now);
  const double beyond = goal.p.y() + f.shapes->ahead_closed() - f.now.X_WO.p.y();
  EXPECT_GT(beyond, 0.005);
  EXPECT_LT(beyond, f.shapes->object("coke").half_extent.y());
  EXPECT_NEAR(goal.p.x(), f.now.X_WO.p.x(), 1e-12);
}

TEST(Stages, PushGoesFarEnoughForSuccessAlsoWhenItGoesLess) {
  Fixture f;
  const auto stages = StagesOf(*ParseTask("push"), *f.shapes);
  const Stage& push = FindStage(stages, "push");
  ASSERT_TRUE(push.nearer);
  const Pose far = push.goal(f.now), near = push.nearer(f.now);
  EXPECT_LT(near.p.y(), far.p.y());
  EXPECT_EQ(near.p.x(), far.p.x());
  EXPECT_EQ(near.p.z(), far.p.z());
  // from the first touch on: 3 cm count as pushed, with something to spare for what rolls back or turns aside
  const double touch = f.now.X_WO.p.y() - f.shapes->object("coke").half_extent.y() - f.shapes->ahead_closed();
  EXPECT_GT(near.p.y() - touch, 0.03 + 0.02);
}

TEST(Stages, AHandOnTheLineDoesNotBackOff) {
  Fixture f;
  const auto stages = StagesOf(*ParseTask("pick"), *f.shapes);
  const auto& approach = FindStage(stages, "approach");
  const double far = approach.goal(f.now).p.y();
  f.now.X_WE.p = {f.now.X_WO.p.x() + 0.01, f.now.X_WO.p.y() - 0.075, f.now.X_WO.p.z()};
  EXPECT_GT(approach.goal(f.now).p.y(), far + 0.015);
}

TEST(Stages, TurningHalfWayLeavesHalfOfTheWayBack) {
  Fixture f;
  const auto stages = StagesOf(*ParseTask("put_down"), *f.shapes);
  const auto& turn = FindStage(stages, "turn");
  f.now.X_WE = {{0.1, 0.3, 0.2}, LevelHand()};
  const Pose goal = turn.goal(f.now);
  f.now.X_WE = {{0.1, 0.5 * (0.3 + goal.p.y()), 0.2}, LevelHand().slerp(0.5, TurnedHand())};
  EXPECT_LT((turn.goal(f.now).p - goal.p).norm(), 1e-6);
}

TEST(Stages, PlaceBringsTheObjectJustAboveTheTable) {
  Fixture f;
  const auto stages = StagesOf(*ParseTask("put_down"), *f.shapes);
  const auto& place = FindStage(stages, "place");
  for (const auto& object : f.scene->objects()) {
    f.now.target = object.name;
    f.now.X_WO.p.z() = object.rest_height;
    const Pose grasp = FindStage(stages, "reach").goal(f.now);
    f.now.X_EO = grasp.inverse() * f.now.X_WO;
    f.now.X_WE = {{0.1, 0.15, 0.2}, TurnedHand()};
    const Pose X_WO = place.goal(f.now) * *f.now.X_EO;
    const double gap = X_WO.p.z() - f.shapes->HeightOnTable(object.name, X_WO.q);
    EXPECT_GE(gap, 0.001) << object.name;
    EXPECT_LE(gap, 0.006) << object.name;
  }
}

}  // namespace task_stages_test
}  // namespace etude::task
