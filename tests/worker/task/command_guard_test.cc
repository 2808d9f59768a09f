// SPDX-License-Identifier: Apache-2.0
#include "worker/task/command_guard.h"

#include <gtest/gtest.h>

#include <Eigen/SVD>
#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "tests/worker/sim/scene_fixture.h"

namespace etude::task {
namespace command_guard_test {

// one for each scene, kept: making one takes as long as a test
collide::Checker* CheckerOf(const std::shared_ptr<const sim::Scene>& scene) {
  static std::map<std::shared_ptr<const sim::Scene>, collide::Checker> checkers;
  return &checkers.try_emplace(scene, scene).first->second;
}

JointBox Box(double most) { return {Eigen::VectorXd::Constant(6, -most), Eigen::VectorXd::Constant(6, most)}; }

TEST(JointVelocityWithin, IsWhatIsAskedWhereTheJointsCan) {
  const Eigen::MatrixXd J = Eigen::MatrixXd::Identity(6, 6);
  const Vector6 asked = Vector6::LinSpaced(-0.5, 0.5);
  EXPECT_LT((JointVelocityWithin(J, asked, Box(1)) - asked).norm(), 1e-5);
}

TEST(JointVelocityWithin, KeepsTheDirectionOfWhatIsTooFast) {
  const Eigen::MatrixXd J = Eigen::MatrixXd::Identity(6, 6);
  Vector6 asked = Vector6::Zero();
  asked.head<2>() << 2, 1;
  const Eigen::VectorXd v = JointVelocityWithin(J, asked, Box(1));
  EXPECT_NEAR(v[0], 1, 1e-9);
  EXPECT_NEAR(v[1], 0.5, 1e-9);
}

TEST(JointVelocityWithin, LeavesOutWhatASingularityAsksWithoutEnd) {
  Eigen::MatrixXd J = Eigen::MatrixXd::Identity(6, 6);
  J(5, 5) = 0.01;
  Vector6 asked = Vector6::Zero();
  asked[0] = 0.1;
  asked[5] = 0.05;  // 5 rad/s of the last joint
  const Eigen::VectorXd v = JointVelocityWithin(J, asked, Box(1));
  EXPECT_NEAR(v[0], 0.1, 1e-3) << "the others do not suffer";
  EXPECT_NEAR(v[5], 1, 1e-2) << "and it does what it can";
  EXPECT_LE(v[5], 1);
}

TEST(JointVelocityWithin, BrakesAJointThatIsTooFastAlready) {
  JointBox box = Box(1);
  box.high[0] = -0.2;
  const Eigen::VectorXd v = JointVelocityWithin(Eigen::MatrixXd::Identity(6, 6), Vector6::Unit(0), box);
  EXPECT_EQ(v[0], -0.2);
}

// How fast the fastest joint turns, of its limit.
double SpeedShare(const sim::World& world) {
  return world.v().cwiseAbs().cwiseQuotient(world.scene().arm().joint_speed).maxCoeff();
}

// How fast a joint gets, of its limit, while the hand follows `reference` (of the control step).
double Fastest(sim::World& world, CommandGuard* guard, int steps, const std::function<Command(int)>& reference) {
  double most = 0;
  for (int i = 0; i < steps; ++i) {
    Command command = reference(i);
    if (guard) command = guard->Guarded(command, world);
    world.Step(command.target, command.V_WE);
    most = std::max(most, SpeedShare(world));
  }
  return most;
}

class CommandGuardOf : public testing::TestWithParam<const char*> {};

TEST_P(CommandGuardOf, LetsPassWhatTheJointsCanFollow) {
  const auto scene = sim::SceneOf(GetParam());
  sim::World world(scene);
  CommandGuard guard(scene, CheckerOf(scene));
  const Pose start = world.X_WE();
  for (int i = 0; i < 50; ++i) {
    Command command;
    command.V_WE[2] = 0.05 * std::min(1.0, i / 25.0);
    command.target.X_WE = {start.p + Eigen::Vector3d(0, 0, 0.05 * i * i / 50 / kControlRate), start.q};
    const Command guarded = guard.Guarded(command, world);
    EXPECT_EQ(guarded.V_WE, command.V_WE);
    EXPECT_EQ(guarded.target.X_WE.p, command.target.X_WE.p);
    EXPECT_EQ(guarded.target.X_WE.q.coeffs(), command.target.X_WE.q.coeffs());
    world.Step(command.target, command.V_WE);
  }
}

// what it hung on gives way: the spring is tight
TEST_P(CommandGuardOf, DoesNotThrowTheHandAfterItsReference) {
  const auto scene = sim::SceneOf(GetParam());
  sim::World free(scene), guarded(scene);
  CommandGuard guard(scene, CheckerOf(scene));
  Command command;
  command.target.X_WE = {free.X_WE().p + Eigen::Vector3d(-0.03, 0.03, 0.06), free.X_WE().q};
  const auto reference = [&](int) { return command; };
  const double unguarded = Fastest(free, nullptr, 150, reference);
  if (std::string(GetParam()) == "jaco2") {
    EXPECT_GT(unguarded, 1.05) << "this is what it is for";
  }
  EXPECT_LE(Fastest(guarded, &guard, 150, reference), 1.0);
  EXPECT_LT((guarded.X_WE().p - command.target.X_WE.p).norm(), 3e-3) << "and it arrives";
}

INSTANTIATE_TEST_SUITE_P(Robots, CommandGuardOf, testing::Values("ur5", "panda", "jaco2"),
                         [](const auto& info) { return std::string(info.param); });

// Whatever it was that had a joint turn too fast: the hand stops, with all its joints.
TEST(CommandGuard, AHandWhoseJointsTurnTooFastIsStopped) {
  const auto scene = sim::SceneOf("jaco2");
  sim::World world(scene);
  CommandGuard guard(scene, CheckerOf(scene));
  Command command;
  command.target = {{world.X_WE().p + Eigen::Vector3d(-0.03, 0.03, 0.06), world.X_WE().q}, 1};
  for (int i = 0; i < 150 && SpeedShare(world) <= 1; ++i) world.Step(command.target, command.V_WE);
  ASSERT_GT(SpeedShare(world), 1) << "nobody guarded it";
  const Command stopped = guard.Guarded(command, world);
  EXPECT_EQ(stopped.V_WE, Vector6(Vector6::Zero()));
  EXPECT_EQ(stopped.target.X_WE.p, world.X_WE().p);
  EXPECT_EQ(stopped.target.gripper, 1);
  const double before = SpeedShare(world);
  for (int i = 0; i < 3; ++i) world.Step(stopped.target, stopped.V_WE);
  EXPECT_LT(SpeedShare(world), 0.7 * before);
}

TEST(CommandGuard, ATargetLeadsTheHandByLittle) {
  const auto scene = sim::SceneOf("ur5");
  sim::World world(scene);
  CommandGuard guard(scene, CheckerOf(scene));
  const Pose X_WE = world.X_WE();
  Command command;
  command.target = {{X_WE.p + Eigen::Vector3d(0, 0, 0.07), FromEuler({0, 0, 0.5}) * X_WE.q}, 1};
  const Command guarded = guard.Guarded(command, world);
  EXPECT_LE((guarded.target.X_WE.p - X_WE.p).norm(), 0.015 + 1e-9);
  EXPECT_GT(guarded.target.X_WE.p.z(), X_WE.p.z()) << "and goes there";
  EXPECT_LE(AngleBetween(guarded.target.X_WE.q, X_WE.q), 0.15 + 1e-6);
  EXPECT_EQ(guarded.target.gripper, 1);
}

// Commands are obeyed later: how far one leads is seen from where the hand will be.
TEST(CommandGuard, AHandThatObeysLateKeepsItsSpeed) {
  SceneSpec spec;
  spec.robot = "ur5";
  spec.world.control_delay = 20;
  const auto built = sim::Scene::Build(spec);
  ASSERT_TRUE(built) << built.error().message;
  sim::World world(*built);
  CommandGuard guard(*built, CheckerOf(*built));
  const Pose start = world.X_WE();
  for (int i = 0; i < 100; ++i) {
    Command command;
    command.V_WE[2] = 0.2 * std::min(1.0, i / 25.0);
    const double way = i < 25 ? 0.5 * i / 25 * i : 12.5 + (i - 25);
    command.target.X_WE = {start.p + Eigen::Vector3d(0, 0, 0.2 * way / kControlRate), start.q};
    const Command guarded = guard.Guarded(command, world);
    world.Step(guarded.target, guarded.V_WE);
  }
  const Eigen::Vector3d before = world.X_WE().p;
  for (int i = 0; i < 5; ++i) world.Step({world.X_WE(), 0}, Vector6::Zero());  // those under way are obeyed first
  EXPECT_NEAR((world.X_WE().p - before).z() * kControlRate / 5, 0.2, 0.02);
}

// The wrist is nearly straight: to turn the hand across it, joints four and six have to turn against each other, fast.
TEST(CommandGuard, AWristThatHasToTurnOverDoesSoNoFasterThanItMay) {
  const auto scene = sim::SceneOf("jaco2");
  Eigen::VectorXd q(6);
  q << 1.40, 4.00, 1.04, -3.24, -0.03, 1.50;
  sim::Kinematics kinematics(scene);
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(kinematics.Jacobian(q), Eigen::ComputeThinU);
  ASSERT_LT(svd.singularValues()[5], 0.05);
  const Vector6 V_WE = 0.1 * svd.matrixU().col(5);
  const auto fastest = [&](CommandGuard* guard) {
    sim::World world(scene);
    world.SetArm(q);
    world.Forward();
    const Pose start = world.X_WE();
    return Fastest(world, guard, 60, [&](int i) {
      Command command;
      command.V_WE = V_WE;
      command.target.X_WE = sim::Advanced(start, V_WE, (i + 1) / kControlRate);
      return command;
    });
  };
  CommandGuard guard(scene, CheckerOf(scene));
  EXPECT_GT(fastest(nullptr), 1.5);
  EXPECT_LE(fastest(&guard), 1.0);
}

// From beside the base to the other side: the shortest way of the hand leads through the arm.
TEST(CommandGuard, AnArmIsNotFoldedIntoItself) {
  const auto scene = sim::SceneOf("ur5");
  collide::Checker& checker = *CheckerOf(scene);
  sim::Kinematics kinematics(scene);
  const Pose home = kinematics.X_WE(scene->arm().q_home);
  const auto q = kinematics.Solve({{-0.128, 0.054, 0.134}, home.q}, scene->arm().q_home);
  ASSERT_TRUE(q);
  const Pose end{{0.30, 0.158, 0.06}, home.q};
  const auto deepest = [&](CommandGuard* guard, Pose* arrived) {
    sim::World world(scene);
    world.SetArm(*q);
    world.Forward();
    const Pose start = world.X_WE();
    double depth = 0;
    for (int i = 0; i < 300; ++i) {
      const double part = std::min(1.0, i / 150.0);
      Command command;
      command.target.X_WE = {start.p + part * (end.p - start.p), start.q};
      if (part < 1) command.V_WE.head<3>() = (end.p - start.p) / 150 * kControlRate;
      if (guard) command = guard->Guarded(command, world);
      world.Step(command.target, command.V_WE);
      for (const auto& overlap : checker.SelfOverlaps(world.ArmPoses(), 0)) depth = std::max(depth, overlap.depth);
    }
    *arrived = world.X_WE();
    return depth;
  };
  CommandGuard guard(scene, &checker);
  Pose arrived;
  EXPECT_GT(deepest(nullptr, &arrived), 0.01) << "this is what it is for";
  EXPECT_EQ(deepest(&guard, &arrived), 0);
  EXPECT_LT((arrived.p - end.p).norm(), 3e-3) << "and the hand gets there";
}

}  // namespace command_guard_test
}  // namespace etude::task
