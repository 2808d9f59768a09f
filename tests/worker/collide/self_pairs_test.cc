// SPDX-License-Identifier: Apache-2.0
// Tests worker/collide/self_pairs.cc
#include "worker/collide/self_pairs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <numbers>
#include <string>

#include "tests/worker/sim/scene_fixture.h"

namespace etude::collide::internal {
namespace self_pairs_test {

class Structure : public testing::TestWithParam<std::string> {
 protected:
  std::shared_ptr<const sim::Scene> scene_ = sim::SceneOf(GetParam());
  const sim::ArmInfo& arm_ = scene_->arm();
  sim::Kinematics kinematics_{scene_};
  ArmStructure structure_ = FindStructure(arm_, kinematics_);
  int n_ = static_cast<int>(arm_.bodies.size());
};

TEST_P(Structure, CountsTheJointsBetweenTwoBodiesOfAChain) {
  const Eigen::MatrixXi& between = structure_.joints_between;
  ASSERT_EQ(between.rows(), n_ + 1);
  EXPECT_EQ(between, between.transpose());
  EXPECT_EQ(between.diagonal().cwiseAbs().maxCoeff(), 0);
  EXPECT_EQ(between(0, n_), 0) << "the base stands still in the world";
  const int joints = static_cast<int>(arm_.joints.size());
  EXPECT_EQ(between(0, structure_.tool_body), joints);
  EXPECT_EQ(between.maxCoeff(), joints);
  // bodies stand base to fingers: on the way to the tool each is as far from the base as the one before, or a joint on
  for (int body = 1; body <= structure_.tool_body; ++body) {
    const int step = between(0, body) - between(0, body - 1);
    EXPECT_TRUE(step == 0 || step == 1) << arm_.bodies[static_cast<std::size_t>(body)];
    EXPECT_EQ(between(body - 1, body), step);
    EXPECT_EQ(between(body, structure_.tool_body), joints - between(0, body)) << "what is before and what is after";
  }
}

TEST_P(Structure, TheToolIsFixedToItsBodyWhateverArmAndGripperDo) {
  const std::string tool_body = arm_.bodies[static_cast<std::size_t>(structure_.tool_body)];
  for (const Eigen::VectorXd& q : SpreadConfigurations(arm_, 10))
    for (const double gripper : {0.0, 0.5, 1.0}) {
      const Pose X_WB = kinematics_.BodyPoses(q, gripper, {tool_body}).front();
      const Pose X_WE = kinematics_.X_WE(q), found = X_WB * structure_.X_BE;
      EXPECT_LT((found.p - X_WE.p).norm(), 1e-9);
      EXPECT_LT(AngleBetween(found.q, X_WE.q), 1e-6);
    }
}

TEST_P(Structure, TheGripperGoesWithTheToolAndTheArmDoesNot) {
  const auto with_tool = [&](const std::string& body) {
    const auto at = std::ranges::find(arm_.bodies, body);
    EXPECT_NE(at, arm_.bodies.end()) << body;
    return static_cast<bool>(structure_.with_tool[static_cast<std::size_t>(at - arm_.bodies.begin())]);
  };
  for (const auto& group : arm_.finger_groups)
    for (const std::string& body : group) EXPECT_TRUE(with_tool(body)) << body;
  EXPECT_TRUE(with_tool(arm_.bodies[static_cast<std::size_t>(structure_.tool_body)]));
  EXPECT_FALSE(with_tool(arm_.bodies.front()));
  EXPECT_LT(std::ranges::count(structure_.with_tool, true), n_);
}

INSTANTIATE_TEST_SUITE_P(Of, Structure, testing::Values("ur5", "panda", "jaco2", "deploy/robots/sketch.yaml"),
                         [](const auto& info) { return std::filesystem::path(info.param).stem().string(); });

TEST(SpreadConfigurations, AreTheSameEachTimeWithinTheLimitsAndWideApart) {
  const sim::ArmInfo& arm = sim::FullScene()->arm();
  constexpr double kPi = std::numbers::pi;
  const auto spread = SpreadConfigurations(arm, 200);
  ASSERT_EQ(spread.size(), 200u);
  EXPECT_EQ(spread, SpreadConfigurations(arm, 200));
  EXPECT_EQ(spread.front(), SpreadConfigurations(arm, 1).front()) << "more of them begin with the same";
  Eigen::VectorXd low = spread.front(), high = spread.front();
  for (const Eigen::VectorXd& q : spread) {
    EXPECT_TRUE((q.array() >= arm.q_min.array()).all() && (q.array() <= arm.q_max.array()).all());
    EXPECT_LE(q.cwiseAbs().maxCoeff(), kPi) << "a second turn is no other configuration";
    low = low.cwiseMin(q);
    high = high.cwiseMax(q);
  }
  for (Eigen::Index joint = 0; joint < arm.q_home.size(); ++joint) {
    const double range = std::min(arm.q_max[joint], kPi) - std::max(arm.q_min[joint], -kPi);
    EXPECT_GT(high[joint] - low[joint], 0.9 * range) << joint;
  }
}

}  // namespace self_pairs_test
}  // namespace etude::collide::internal
