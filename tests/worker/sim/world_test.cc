// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/world.h"

#include <gmock/gmock.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>

#include "tests/worker/sim/scene_fixture.h"
#include "worker/sim/model.h"

namespace etude::sim {
namespace world_test {

constexpr double kDegree = std::numbers::pi / 180;

/// Everything that the future depends on, bit for bit.
std::vector<double> Bits(const World& world) {
  const mjModel* mj = world.scene().model().mj.get();
  const mjData* data = world.state().mj.get();
  std::vector<double> bits(data->qpos, data->qpos + mj->nq);
  bits.insert(bits.end(), data->qvel, data->qvel + mj->nv);
  bits.insert(bits.end(), data->qacc_warmstart, data->qacc_warmstart + mj->nv);
  bits.push_back(data->time);
  return bits;
}

void Hold(World& world, int steps, double gripper = 0) {
  const Pose X = world.X_WE();
  for (int i = 0; i < steps; ++i) world.Step({X, gripper}, Vector6d::Zero());
}

TEST(World, TimeIsControlSteps) {
  World world(FullScene());
  EXPECT_EQ(world.time(), 0);
  Hold(world, 10);
  EXPECT_NEAR(world.time(), 0.080, 1e-12);
  EXPECT_EQ(world.StateVector().size(),
            static_cast<std::size_t>(FullScene()->model().mj->nq + FullScene()->model().mj->nv));
}

TEST(World, HoldsStill) {
  World world(FullScene());
  const Pose X = world.X_WE();
  for (int i = 0; i < 250; ++i) {
    world.Step({X, i % 100 < 50 ? 0.0 : 1.0}, Vector6d::Zero());
    ASSERT_LT((world.X_WE().p - X.p).norm(), 0.3e-3) << "step " << i;
    ASSERT_LT(AngleBetween(world.X_WE().q, X.q), 3e-3) << "step " << i;
  }
  EXPECT_TRUE(world.healthy());
}

TEST(World, TracksAStraightPath) {
  World world(FullScene());
  double worst = 0;
  const auto each = [&](const Pose& target) { worst = std::max(worst, (world.X_WE().p - target.p).norm()); };
  const Eigen::Quaterniond level = world.X_WE().q;
  MoveTo(world, {{-0.30, 0.20, 0.30}, level}, 0.3, 0, 30, each);
  MoveTo(world, {{0.30, 0.25, 0.30}, level}, 0.3, 0, 30, each);
  MoveTo(world, {{0.05, 0.10, 0.20}, level}, 0.3, 0, 30, each);
  EXPECT_LT(worst, 3e-3);
  EXPECT_LT((world.X_WE().p - Eigen::Vector3d(0.05, 0.10, 0.20)).norm(), 0.3e-3);
  EXPECT_TRUE(world.healthy());
  RecordProperty("worst_mm", std::to_string(worst * 1e3));
}

TEST(World, ObjectsStandWhereTheyArePut) {
  World world(FullScene());
  std::vector<Pose> start;
  int i = 0;
  for (const ObjectInfo& object : FullScene()->objects()) {
    const Pose X{{-0.35 + 0.14 * i, 0.28 + 0.02 * (i % 3), object.rest_height},
                 Eigen::Quaterniond(Eigen::AngleAxisd(0.12 * (i - 3), Eigen::Vector3d::UnitZ()))};
    world.SetObject(object.name, X);
    start.push_back(X);
    ++i;
  }
  world.Forward();
  Hold(world, 250);
  i = 0;
  for (const ObjectInfo& object : FullScene()->objects()) {
    const Pose X = world.ObjectPose(object.name);
    EXPECT_LT((X.p - start[i].p).norm(), 1e-3) << object.name;
    EXPECT_LT(AngleBetween(X.q, start[i].q), 0.5 * kDegree) << object.name;
    EXPECT_THAT(world.ContactsOf(object.name), testing::ElementsAre("world"));
    EXPECT_FALSE(world.Grasped(object.name));
    ++i;
  }
  EXPECT_TRUE(world.healthy());
}

TEST(World, GripperClosesAndOpensInTime) {
  World world(FullScene());
  EXPECT_NEAR(world.gripper_q()[0], 0, 1e-3);
  Hold(world, 60, 1);
  EXPECT_NEAR(world.gripper_q()[0], 0.8, 0.02);
  Hold(world, 60, 0);
  EXPECT_NEAR(world.gripper_q()[0], 0.0, 0.02);
  EXPECT_TRUE(world.healthy());
}

/// A run with contacts: the hand ploughs through the cans.
std::vector<double> Plough(World& world) {
  const Pose home = world.X_WE();
  MoveTo(world, {home.p + Eigen::Vector3d(-0.10, 0.22, 0), home.q}, 0.3, 1, 5, [](const Pose&) {});
  MoveTo(world, {home.p + Eigen::Vector3d(0.20, 0.22, 0), home.q}, 0.3, 0, 5, [](const Pose&) {});
  return Bits(world);
}

TEST(World, ResetMakesTheFutureTheSameBitForBit) {
  World world(FullScene());
  const std::vector<double> first = Bits(world);
  const std::vector<double> end = Plough(world);
  EXPECT_NE(first, end);
  world.Reset();
  EXPECT_EQ(Bits(world), first);
  EXPECT_EQ(Plough(world), end);

  World other(FullScene());
  EXPECT_EQ(Plough(other), end);

  // after Reset, other places, and back: nothing of the detour stays
  world.Reset();
  world.SetObject("coke", {{0.1, 0.5, 0.3}, FromEuler({1, 0, 0})});
  world.SetArm(world.scene().arm().q_home + Eigen::VectorXd::Constant(6, 0.1));
  world.Forward();
  Hold(world, 50, 1);
  world.Reset();
  EXPECT_EQ(Plough(world), end);
}

TEST(World, PosesBelongToTheSameInstantAsJoints) {
  World world(FullScene());
  Kinematics kinematics(FullScene());
  MoveTo(world, {{0.0, 0.2, 0.3}, world.X_WE().q}, 0.3, 0, 0, [&](const Pose&) {
    ASSERT_LT((kinematics.X_WE(world.q()).p - world.X_WE().p).norm(), 1e-9);
    ASSERT_LT((kinematics.Jacobian(world.q()) * world.v()).norm(), 2);
  });
}

TEST(World, ControlDelayShiftsWhatTheArmDoes) {
  constexpr int kDelay = 6, kSteps = 60;
  SceneSpec spec;
  spec.world.control_delay = kDelay;
  const auto scene = Scene::Build(spec);
  ASSERT_TRUE(scene) << scene.error().message;
  World late(*scene), prompt(FullScene());
  const Pose start = prompt.X_WE();
  const auto target = [&](int step) {
    return Waypoint{{start.p + Eigen::Vector3d(0, 0.002 * step, 0.001 * step), start.q}, 0};
  };

  // the late arm holds for kDelay steps, the prompt one is told to; from then on they do the same
  for (int step = 0; step < kDelay; ++step) prompt.Step({start, 0}, Vector6d::Zero());
  std::vector<Eigen::VectorXd> expected;
  for (int step = 0; step < kSteps; ++step) {
    prompt.Step(target(step), Vector6d::Zero());
    expected.push_back(prompt.q());
  }
  for (int round = 0; round < 2; ++round) {
    late.Reset();
    for (int step = 0; step < kSteps + kDelay; ++step) {
      late.Step(target(step), Vector6d::Zero());
      if (step < kDelay) continue;
      ASSERT_EQ(late.q(), expected[static_cast<std::size_t>(step - kDelay)]) << step;
    }
  }
}

TEST(World, SaysWhenTheSimulationBroke) {
  World world(FullScene());
  EXPECT_TRUE(world.healthy());
  world.SetObject("cube", {{std::numeric_limits<double>::quiet_NaN(), 0, 0.1}, Eigen::Quaterniond::Identity()});
  world.Forward();
  EXPECT_FALSE(world.healthy());
  world.Reset();
  EXPECT_TRUE(world.healthy());
}

// Slides `name` by `by` along a smooth step of 25 control steps.
void Slide(World& world, const std::string& name, const Eigen::Vector3d& by) {
  const Pose start = world.ObjectPose(name);
  const Pose hand = world.X_WE();
  for (int i = 1; i <= 25; ++i) {
    const double s = i / 25.0;
    world.Guide(name, {start.p + s * s * (3 - 2 * s) * by, start.q}, 6 * s * (1 - s) / 0.2 * by);
    world.Step({hand, 0}, Vector6d::Zero());
  }
}

TEST(World, GuidesEveryObjectUprightOverTheTable) {
  World world(FullScene());
  for (const ObjectInfo& object : FullScene()->objects()) {
    world.Reset();
    double x = -1;  // the others stand in a row behind the robot
    for (const ObjectInfo& other : FullScene()->objects())
      world.SetObject(other.name, {{x += 0.25, -0.6, other.rest_height}, Eigen::Quaterniond::Identity()});
    world.SetObject(object.name, {{0.1, 0.3, object.rest_height}, FromEuler({0, 0, 0.2})});
    world.Forward();
    Hold(world, 30);
    const Pose before = world.ObjectPose(object.name);
    const Eigen::Vector3d by(0.04, -0.045, 0);
    Slide(world, object.name, by);
    const Pose after = world.ObjectPose(object.name);
    EXPECT_LT((after.p - before.p - by).norm(), 2e-3) << object.name;
    EXPECT_LT(AngleBetween(after.q, before.q), 0.03) << object.name;
    Hold(world, 50);
    EXPECT_LT((world.ObjectPose(object.name).p - after.p).norm(), 2e-3) << object.name << " is let go at rest";
    EXPECT_TRUE(world.healthy());
  }
}

TEST(World, GuidesForOneStepOnly) {
  World once(FullScene()), never(FullScene());
  Hold(once, 20), Hold(never, 20);
  once.Guide("coke", {{0.3, 0.3, 0}, Eigen::Quaterniond::Identity()}, Eigen::Vector3d::Zero());
  once.Reset(), never.Reset();
  Hold(once, 5), Hold(never, 5);
  EXPECT_EQ(Bits(once), Bits(never)) << "a reset takes it back";

  const Pose coke = once.ObjectPose("coke");
  once.Guide("coke", {coke.p + Eigen::Vector3d(0.05, 0, 0), coke.q}, Eigen::Vector3d::Zero());
  Hold(once, 1);
  EXPECT_LT((once.ObjectPose("coke").p - coke.p - Eigen::Vector3d(0.05, 0, 0)).norm(), 1e-9);
  once.SetObject("coke", coke);
  once.Forward();
  Hold(once, 100);
  EXPECT_LT((once.ObjectPose("coke").p - coke.p).norm(), 2e-3) << "later steps are its own";
}

}  // namespace world_test
}  // namespace etude::sim
