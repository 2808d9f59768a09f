// SPDX-License-Identifier: Apache-2.0
// What holds of every robot: published kinematics, reach, control, and a grasp of every object.
#include <gmock/gmock.h>

#include <array>
#include <cmath>
#include <numbers>

#include "services/core/file.h"
#include "services/core/rng.h"
#include "tests/worker/sim/scene_fixture.h"
#include "worker/sim/controller.h"
#include "worker/sim/model.h"

namespace etude::sim {
namespace robots_test {

using Eigen::Isometry3d;
using Eigen::Translation3d;
using Eigen::Vector3d;
using std::numbers::pi;

/// The hand as it comes at an object from `pitch` below the horizontal, fingers closing along x.
Eigen::Quaterniond NaturalHand(double pitch) {
  return Eigen::AngleAxisd(-pitch, Vector3d::UnitX()) * FromEuler({pi, 0, pi / 2});
}

Eigen::AngleAxisd TurnX(double angle) { return {angle, Vector3d::UnitX()}; }
Eigen::AngleAxisd TurnZ(double angle) { return {angle, Vector3d::UnitZ()}; }

// The tools by the published tables, written down here again, independent of the MJCF. z ahead along the hand,
// x along the opening.

/// Franka: table after Craig, flange, hand turned by -45 degrees.
Isometry3d PandaByTable(const Eigen::VectorXd& q) {
  const std::array<double, 7> a{0, 0, 0, 0.0825, -0.0825, 0, 0.088}, d{0.333, 0, 0.316, 0, 0.384, 0, 0},
      alpha{0, -pi / 2, pi / 2, pi / 2, -pi / 2, pi / 2, pi / 2};
  Isometry3d T = Translation3d(0, -0.3, 0) * TurnZ(pi / 2);
  for (int i = 0; i < 7; ++i)
    T = T * TurnX(alpha[i]) * Translation3d(a[i], 0, 0) * TurnZ(q[i]) * Translation3d(0, 0, d[i]);
  // the hand opens along its y
  return T * Translation3d(0, 0, 0.107 + 0.1034) * TurnZ(-pi / 4) * TurnZ(-pi / 2);
}

/// Kinova: classic table; the robot's own angles; 20 mm beyond the published end effector.
Isometry3d JacoByTable(const Eigen::VectorXd& q) {
  const double aa = pi / 6, k = std::sin(aa) / std::sin(2 * aa);
  const std::array<double, 6> a{0, 0.41, 0, 0, 0, 0};
  const std::array<double, 6> d{
      0.2755, 0, -0.0098, -(0.2073 + k * 0.0741), -k * (0.0741 + 0.0741), -(k * 0.0741 + 0.16)};
  const std::array<double, 6> alpha{pi / 2, pi, pi / 2, 2 * aa, 2 * aa, pi};
  const std::array<double, 6> theta{-q[0], q[1] - pi / 2, q[2] + pi / 2, q[3], q[4] - pi, q[5] + pi / 2};
  Isometry3d T(Translation3d(0, -0.2, 0));
  for (int i = 0; i < 6; ++i) T = T * TurnZ(theta[i]) * Translation3d(a[i], 0, d[i]) * TurnX(alpha[i]);
  // the hand opens along its y
  return T * Translation3d(0, 0, 0.02) * TurnZ(pi / 2);
}

/// Universal Robots: classic table.
Isometry3d Ur5ByTable(const Eigen::VectorXd& q) {
  const std::array<double, 6> a{0, -0.425, -0.39225, 0, 0, 0}, d{0.089159, 0, 0, 0.10915, 0.09465, 0.0823},
      alpha{pi / 2, 0, 0, pi / 2, -pi / 2, 0};
  Isometry3d T(Translation3d(0, -0.3, 0));
  for (int i = 0; i < 6; ++i) T = T * TurnZ(q[i]) * Translation3d(a[i], 0, d[i]) * TurnX(alpha[i]);
  return T * Translation3d(0, 0, 0.177);
}

struct Case {
  std::string name;
  Isometry3d (*by_table)(const Eigen::VectorXd&);
};

class Robot : public testing::TestWithParam<Case> {
 protected:
  std::shared_ptr<const Scene> scene_ = SceneOf(GetParam().name);
  const ArmInfo& arm_ = scene_->arm();

  /// Within the limits and one turn.
  Eigen::VectorXd RandomJoints(Rng& rng) const {
    Eigen::VectorXd q(arm_.q_home.size());
    for (int i = 0; i < q.size(); ++i)
      q[i] = rng.Uniform(std::max(arm_.q_min[i], -pi), std::min(arm_.q_max[i], pi + (arm_.q_min[i] > -pi ? pi : 0)));
    return q;
  }
};

TEST_P(Robot, FollowsThePublishedTable) {
  Kinematics kinematics(scene_);
  Rng rng(1);
  for (int k = 0; k < 1000; ++k) {
    const Eigen::VectorXd q = RandomJoints(rng);
    const Pose X = kinematics.X_WE(q);
    const Isometry3d T = GetParam().by_table(q);
    ASSERT_LT((X.p - T.translation()).norm(), 1e-4) << "q = " << q.transpose();
    ASSERT_LT((X.q * Vector3d::UnitX() + T.linear().col(2)).norm(), 1e-4) << "q = " << q.transpose();
    ASSERT_NEAR(std::abs((X.q * Vector3d::UnitY()).dot(T.linear().col(0))), 1, 1e-7) << "q = " << q.transpose();
  }
}

TEST_P(Robot, SaysWhatItCanDo) {
  const auto n = static_cast<Eigen::Index>(arm_.joints.size());
  EXPECT_EQ(arm_.q_home.size(), n);
  ASSERT_EQ(arm_.joint_speed.size(), n);
  EXPECT_GT(arm_.joint_speed.minCoeff(), 0.5);
  EXPECT_GT(arm_.torque_limit.minCoeff(), 5);
  EXPECT_TRUE(((arm_.q_home - arm_.q_min).array() > 0.2).all()) << arm_.q_home.transpose();
  EXPECT_TRUE(((arm_.q_max - arm_.q_home).array() > 0.2).all()) << arm_.q_home.transpose();
  EXPECT_GE(arm_.finger_groups.size(), 2u);
  EXPECT_NE(arm_.gripper_open, arm_.gripper_closed);
}

// where objects are placed, and up to where they are lifted
TEST_P(Robot, ReachesTheTableInItsNaturalWay) {
  Kinematics kinematics(scene_);
  for (double x = -0.43; x <= 0.431; x += 0.086)
    for (double y = 0.10; y <= (std::abs(x) > 0.31 ? 0.301 : 0.401); y += 0.05)
      for (const double z : {0.06, 0.18, 0.30}) {
        const Pose X{{x, y, z}, NaturalHand(arm_.approach_pitch)};
        EXPECT_TRUE(kinematics.Solve(X, arm_.q_home)) << x << " " << y << " " << z;
      }
}

TEST_P(Robot, SolvesAsAFunctionOfTheToolWhateverTheSeed) {
  Kinematics kinematics(scene_);
  Rng rng(2);
  for (int k = 0; k < 40; ++k) {
    const Pose X{{rng.Uniform(-0.3, 0.3), rng.Uniform(0.15, 0.35), rng.Uniform(0.1, 0.25)},
                 NaturalHand(arm_.approach_pitch)};
    const auto q = kinematics.Solve(X, arm_.q_home);
    ASSERT_TRUE(q);
    EXPECT_EQ(*kinematics.Solve(X, arm_.q_home), *q);
    Eigen::VectorXd seed = *q;
    for (double& value : seed) value += rng.Uniform(-0.1, 0.1);
    const auto again = kinematics.Solve(X, seed.cwiseMax(arm_.q_min).cwiseMin(arm_.q_max));
    ASSERT_TRUE(again);
    EXPECT_LT((*again - *q).cwiseAbs().maxCoeff(), 5e-3) << "redundancy is resolved towards home";
  }
}

const auto kIgnore = [](const Pose&) {};

TEST_P(Robot, SettlesOnAPose) {
  World world(scene_);
  const Pose target{{0.15, 0.28, 0.22}, NaturalHand(arm_.approach_pitch)};
  MoveTo(world, target, 0.3, 0, 100, kIgnore);
  EXPECT_LT((world.X_WE().p - target.p).norm(), 1e-3);
  EXPECT_LT(AngleBetween(world.X_WE().q, target.q), 5e-3);
  EXPECT_LT(world.v().norm(), 1e-2);
  EXPECT_TRUE(world.healthy());
}

// To and fro for a minute: the elbow of a redundant arm stays where inverse kinematics would have it.
TEST_P(Robot, DoesNotDriftInItsNullSpace) {
  World world(scene_);
  Kinematics kinematics(scene_);
  const Eigen::Quaterniond hand = NaturalHand(arm_.approach_pitch);
  Pose target;
  for (int round = 0; round < 10; ++round)
    for (const Vector3d& p : {Vector3d(0.3, 0.2, 0.15), Vector3d(-0.3, 0.2, 0.25), Vector3d(0, 0.38, 0.2)}) {
      target = {p, hand};
      MoveTo(world, target, 0.5, 0, 0, kIgnore);
    }
  MoveTo(world, target, 0.5, 0, 125, kIgnore);
  const auto q = kinematics.Solve(target, arm_.q_home);
  ASSERT_TRUE(q);
  EXPECT_LT((world.q() - *q).cwiseAbs().maxCoeff(), 0.02) << world.q().transpose() << " | " << q->transpose();
}

class RobotGrasp : public testing::TestWithParam<std::tuple<std::string, std::string>> {};

TEST_P(RobotGrasp, LiftsAndHoldsWithoutCreeping) {
  const auto& [robot, object] = GetParam();
  const auto scene = SceneOf(robot);
  const ArmInfo& arm = scene->arm();
  World world(scene);
  Kinematics kinematics(scene);
  const Eigen::Quaterniond hand = NaturalHand(arm.approach_pitch);
  const Vector3d approach = hand * -Vector3d::UnitX();
  const Pose X_WO = world.ObjectPose(object);
  const auto info = std::ranges::find(scene->objects(), object, &ObjectInfo::name);
  // from above the palm stays clear of the object's top; from the side the pads go past its middle
  Vector3d grasp = X_WO.p + Vector3d(0.003, 0.02, 0.01);
  if (approach.z() < -0.5) grasp = {X_WO.p.x() + 0.003, X_WO.p.y(), 2 * info->half_extent.z() - 0.028};
  const auto ready = kinematics.Solve({grasp - 0.15 * approach, hand}, arm.q_home);
  ASSERT_TRUE(ready);
  world.SetArm(*ready);
  world.Forward();
  MoveTo(world, {grasp, hand}, 0.3, 0, 10, kIgnore);
  EXPECT_LT((world.ObjectPose(object).p - X_WO.p).norm(), 1e-3) << "the approach must not touch it";
  for (int i = 0; i < 80 && !world.Grasped(object); ++i) world.Step({{grasp, hand}, 1}, Vector6d::Zero());
  for (int i = 0; i < 12; ++i) world.Step({{grasp, hand}, 1}, Vector6d::Zero());
  ASSERT_TRUE(world.Grasped(object)) << "fingers at " << world.gripper_q()[0];

  const Pose up{grasp + Vector3d(0, 0, 0.15), hand};
  MoveTo(world, up, 0.4, 1, 25, kIgnore);
  const Pose X_EO = world.X_WE().inverse() * world.ObjectPose(object);
  MoveTo(world, up, 0.4, 1, 250, kIgnore);
  const Pose X_EO_end = world.X_WE().inverse() * world.ObjectPose(object);
  ASSERT_TRUE(world.Grasped(object));
  EXPECT_GT(world.ObjectPose(object).p.z(), X_WO.p.z() + 0.14);
  EXPECT_LT((X_EO_end.p - X_EO.p).norm(), 3e-3);
  EXPECT_LT(AngleBetween(X_EO_end.q, X_EO.q), 3 * pi / 180);
  RecordProperty("creep_mm", std::to_string((X_EO_end.p - X_EO.p).norm() * 1e3));

  // it is let go of again
  MoveTo(world, up, 0.4, 0, 60, kIgnore);
  EXPECT_FALSE(world.Grasped(object));
  EXPECT_TRUE(world.healthy());
}

// The heaviest that a hand is made for: half a kilogram, swung about.
TEST_P(Robot, HoldsHalfAKilogram) {
  SceneSpec spec;
  spec.robot = GetParam().name;
  spec.objects = {"cube"};
  const auto scene = *Scene::Build(spec);
  mjModel* mj = scene->model().mj.get();
  const int body = scene->model().BodyId("cube");
  const double factor = 0.5 / mj->body_mass[body];
  mj->body_mass[body] *= factor;
  for (int k = 0; k < 3; ++k) mj->body_inertia[3 * body + k] *= factor;
  mj_setConst(mj, scene->model().NewData().get());

  World world(scene);
  Kinematics kinematics(scene);
  const Eigen::Quaterniond hand = NaturalHand(arm_.approach_pitch);
  const Vector3d approach = hand * -Vector3d::UnitX();
  const Vector3d grasp = approach.z() < -0.5 ? Vector3d(0, 0.3, 0.072) : Vector3d(0, 0.32, 0.06);
  const auto ready = kinematics.Solve({grasp - 0.15 * approach, hand}, arm_.q_home);
  ASSERT_TRUE(ready);
  world.SetArm(*ready);
  world.Forward();
  MoveTo(world, {grasp, hand}, 0.3, 0, 10, kIgnore);
  MoveTo(world, {grasp, hand}, 0.3, 1, 90, kIgnore);
  MoveTo(world, {grasp + Vector3d(0, -0.05, 0.15), hand}, 0.3, 1, 25, kIgnore);
  ASSERT_TRUE(world.Grasped("cube"));
  const Pose X_EO = world.X_WE().inverse() * world.ObjectPose("cube");
  MoveTo(world, {grasp + Vector3d(0.15, -0.05, 0.15), hand}, 0.4, 1, 0, kIgnore);
  MoveTo(world, {grasp + Vector3d(-0.10, -0.05, 0.12), hand}, 0.4, 1, 200, kIgnore);
  const Pose X_EO_end = world.X_WE().inverse() * world.ObjectPose("cube");
  EXPECT_TRUE(world.Grasped("cube"));
  EXPECT_LT((X_EO_end.p - X_EO.p).norm(), 3e-3);
  EXPECT_LT(AngleBetween(X_EO_end.q, X_EO.q), 5 * pi / 180);
}

INSTANTIATE_TEST_SUITE_P(Every, Robot,
                         testing::Values(Case{"ur5", Ur5ByTable}, Case{"panda", PandaByTable},
                                         Case{"jaco2", JacoByTable}),
                         [](const auto& info) { return info.param.name; });
INSTANTIATE_TEST_SUITE_P(Every, RobotGrasp,
                         testing::Combine(testing::Values("ur5", "panda", "jaco2", "deploy/robots/sketch.yaml"),
                                          testing::Values("cube", "coke", "pepsi", "milk", "bread", "bottle")),
                         [](const auto& info) {
                           return Path(std::get<0>(info.param)).stem().string() + "_" + std::get<1>(info.param);
                         });

}  // namespace robots_test
}  // namespace etude::sim
