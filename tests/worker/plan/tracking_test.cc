// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/tracking.h"

#include <gtest/gtest.h>

#include "tests/worker/sim/scene_fixture.h"

namespace etude::plan {
namespace tracking_test {

class TrackingTest : public testing::Test {
 protected:
  /// From home to a place beside it, the hand turned.
  Motion Turning(double linear, double angular) {
    const Pose X_WE = kinematics_.X_WE(q_home());
    Pose goal = X_WE;
    goal.p += Eigen::Vector3d(0.2, 0.15, -0.1);
    goal.q = Eigen::AngleAxisd(0.8, Eigen::Vector3d(0.4, 0.3, 0.87).normalized()) * X_WE.q;
    return StraightMotion(X_WE, goal, {.linear = linear, .angular = angular, .linear_accel = 3, .angular_accel = 10},
                          0);
  }
  const Eigen::VectorXd& q_home() const { return scene_->arm().q_home; }

  std::shared_ptr<const sim::Scene> scene_ = sim::SceneOf("panda");
  sim::Kinematics kinematics_{scene_};
};

// The physics of the simulation are the reference.
TEST_F(TrackingTest, IsWhatTheSimulatedArmDoes) {
  const Motion motion = Turning(0.7, 2.4);
  const auto velocities = TrackedVelocities(kinematics_, scene_->arm(), motion, q_home());
  ASSERT_EQ(static_cast<int>(velocities.size()), motion.steps());
  sim::World world(scene_);
  world.Reset();
  double x = 1;
  for (const auto& object : scene_->objects()) world.SetObject(object.name, {{x += 0.2, 1, object.rest_height}, {}});
  world.SetArm(q_home());
  world.Forward();
  double peak = 0, farthest = 0;
  for (int k = 0; k < motion.steps(); ++k) {
    world.Step({motion.X_WE[k], 0}, motion.V_WE[k]);
    peak = std::max(peak, velocities[k].cwiseAbs().maxCoeff());
    farthest = std::max(farthest, (world.v() - velocities[k]).cwiseAbs().maxCoeff());
  }
  EXPECT_GT(peak, 0.8);
  EXPECT_LT(farthest, 0.1 * peak);
}

// Where there is time for the slide home, the joints are where inverse kinematics has them.
TEST_F(TrackingTest, OfASlowMotionIsInverseKinematics) {
  const Motion motion = Turning(0.02, 0.1);
  const auto velocities = TrackedVelocities(kinematics_, scene_->arm(), motion, q_home());
  Eigen::VectorXd q = q_home();
  double peak = 0, farthest = 0;
  for (int k = 1; k < motion.steps(); ++k) {
    const auto next = kinematics_.Solve(motion.X_WE[k], q);
    ASSERT_TRUE(next) << k;
    const Eigen::VectorXd v = (*next - q) * kControlRate;
    q = *next;
    peak = std::max(peak, v.cwiseAbs().maxCoeff());
    farthest = std::max(farthest, (v - velocities[k]).cwiseAbs().maxCoeff());
  }
  EXPECT_LT(farthest, 0.25 * peak);
}

TEST_F(TrackingTest, KeepsTheSpeedThatAMotionBeginsWith) {
  const Pose X_WE = kinematics_.X_WE(q_home());
  const Motion motion = StraightMotion(X_WE, {X_WE.p + Eigen::Vector3d(0.1, 0, 0), X_WE.q}, {}, 0.2);
  const auto velocities = TrackedVelocities(kinematics_, scene_->arm(), motion, q_home());
  const Eigen::VectorXd tool = kinematics_.Jacobian(q_home()) * velocities.front();
  EXPECT_NEAR(tool.head<3>().norm(), motion.V_WE.front().head<3>().norm(), 0.03);
}

}  // namespace tracking_test
}  // namespace etude::plan
