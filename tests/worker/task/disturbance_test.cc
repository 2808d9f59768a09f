// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/disturbance.cc
#include "worker/task/disturbance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "tests/worker/sim/scene_fixture.h"

namespace etude::task {
namespace disturbance_test {

TEST(DrawPush, StaysWithinTheSpec) {
  RandomizationSpec randomization;
  randomization.disturbance = 0.03;
  Rng rng(5);
  double longest = 0;
  for (int i = 0; i < 2000; ++i) {
    const Push push = DrawPush(randomization, rng);
    EXPECT_LE(push.offset.norm(), 0.03);
    EXPECT_GE(push.steps, 20);
    EXPECT_LE(push.steps, 30);
    longest = std::max(longest, push.offset.norm());
  }
  EXPECT_GT(longest, 0.027);
}

TEST(PushMotion, LeavesThePathSmoothlyAndEndsAtRestBesideIt) {
  const auto path = plan::StraightMotion({}, {{0.4, 0, 0}, Eigen::Quaterniond::Identity()}, {});
  const Push push{{0, 0.03, 0}, {0, 0, 0.1}, 25};
  const int from = path.steps() / 2;
  const auto pushed = PushMotion(path, from, push);
  ASSERT_EQ(pushed.steps(), 25);
  Eigen::Vector3d last = path.X_WE[from].p;
  Eigen::Vector3d last_velocity = path.V_WE[from].head<3>();
  for (int i = 0; i < pushed.steps(); ++i) {
    const Eigen::Vector3d velocity = (pushed.X_WE[i].p - last) * kControlRate;
    EXPECT_LT((velocity - last_velocity).norm(), 0.06) << i;
    EXPECT_LT((velocity - pushed.V_WE[i].head<3>()).norm(), 0.06) << i;
    last = pushed.X_WE[i].p;
    last_velocity = velocity;
  }
  EXPECT_NEAR(pushed.X_WE.back().p.y(), 0.03, 1e-9);
  EXPECT_NEAR(AngleBetween(pushed.X_WE.back().q, path.X_WE[from].q), 0.1, 1e-6);
  EXPECT_LT(pushed.V_WE.back().norm(), 0.02);
}

TEST(PushMotion, MayBeginNearTheEnd) {
  const auto path = plan::StraightMotion({}, {{0.1, 0, 0}, Eigen::Quaterniond::Identity()}, {});
  const auto pushed = PushMotion(path, path.steps() - 1, {{0, 0, 0.02}, {0, 0, 0}, 20});
  EXPECT_NEAR(pushed.X_WE.back().p.z(), 0.02, 1e-9);
  EXPECT_NEAR(pushed.X_WE.back().p.x(), 0.1, 1e-3);
}

// ---- JudgePush -------------------------------------------------------------------------------------

class JudgePushTest : public testing::Test {
 protected:
  // A push off a way to the side, from its middle or after another share of it.
  plan::Motion Pushed(const Eigen::Vector3d& offset, int steps, double share = 0.5) {
    const Pose home = kinematics_.X_WE(arm_.q_home);
    Pose goal = home;
    goal.p += Eigen::Vector3d(0.25, 0, 0.1);
    const plan::Motion path = plan::StraightMotion(home, goal, {});
    return PushMotion(path, static_cast<int>(share * path.steps()), {offset, {0, 0, 0.05}, steps});
  }
  Eigen::VectorXd StartOf(const plan::Motion& motion) {
    const auto q = kinematics_.Solve(motion.X_WE.front(), arm_.q_home);
    EXPECT_TRUE(q);
    return q.value_or(arm_.q_home);
  }
  PushVerdict Judge(const plan::Motion& motion, const Eigen::VectorXd& joint_speed) {
    return JudgePush(motion, StartOf(motion), joint_speed, kinematics_, checker_);
  }
  PushVerdict Judge(const plan::Motion& motion) { return Judge(motion, arm_.planned_speed); }
  // The fastest that any joint moves from one control step to the next, rad/s.
  double FastestJoint(const plan::Motion& motion) {
    Eigen::VectorXd q = StartOf(motion);
    double fastest = 0;
    for (int k = 1; k < motion.steps(); ++k) {
      const auto next = kinematics_.Solve(motion.X_WE[k], q);
      EXPECT_TRUE(next);
      if (!next) break;
      fastest = std::max(fastest, (*next - q).cwiseAbs().maxCoeff() * kControlRate);
      q = *next;
    }
    return fastest;
  }
  void PutCube(const Eigen::Vector3d& p) { checker_.SetObject("cube", {p, Eigen::Quaterniond::Identity()}); }

  std::shared_ptr<const sim::Scene> scene_ = sim::FullScene();
  const sim::ArmInfo& arm_ = scene_->arm();
  sim::Kinematics kinematics_{scene_};
  collide::Checker checker_{scene_};
};

TEST_F(JudgePushTest, IsFreeWhereNothingIsNear) { EXPECT_EQ(Judge(Pushed({0, 0, 0.03}, 25)), PushVerdict::kFree); }

TEST_F(JudgePushTest, IsTooFastWhereAJointIs) {
  for (const Eigen::Vector3d& offset : {Eigen::Vector3d(0, 0, 0.03), Eigen::Vector3d(0, 0.03, 0)}) {
    const plan::Motion motion = Pushed(offset, 25);
    const double fastest = FastestJoint(motion);
    const Eigen::VectorXd one = Eigen::VectorXd::Ones(arm_.q_home.size());
    EXPECT_EQ(Judge(motion, 1.05 * fastest * one), PushVerdict::kFree);
    EXPECT_EQ(Judge(motion, 0.7 * fastest * one), PushVerdict::kTooFast) << "it looks at every fifth step";
  }
}

TEST_F(JudgePushTest, EachJointHasItsOwnLimit) {
  const plan::Motion motion = Pushed({0, 0, 0.03}, 25);
  const Eigen::VectorXd plenty = Eigen::VectorXd::Constant(arm_.q_home.size(), 100);
  ASSERT_EQ(Judge(motion, plenty), PushVerdict::kFree);
  int bounded = 0;
  for (Eigen::Index joint = 0; joint < plenty.size(); ++joint) {
    Eigen::VectorXd limits = plenty;
    limits[joint] = 1e-4;
    bounded += Judge(motion, limits) == PushVerdict::kTooFast ? 1 : 0;
  }
  EXPECT_GE(bounded, 3) << "several joints move, and any of them may be the slow one";
}

TEST_F(JudgePushTest, SlowerIsFreeWhereTooFastWasTheOnlyObjection) {
  // at the end, where the way itself is at rest
  const plan::Motion quick = Pushed({0, 0.03, 0.05}, 20, 0.99), slow = Pushed({0, 0.03, 0.05}, 80, 0.99);
  const double fastest = FastestJoint(quick), fastest_slow = FastestJoint(slow);
  ASSERT_LT(fastest_slow, 0.7 * fastest);
  const Eigen::VectorXd limits = Eigen::VectorXd::Constant(arm_.q_home.size(), 0.75 * fastest);
  EXPECT_EQ(Judge(quick, limits), PushVerdict::kTooFast);
  EXPECT_EQ(Judge(slow, limits), PushVerdict::kFree);
}

TEST_F(JudgePushTest, IsBlockedByWhatStandsWhereItLeads) {
  const plan::Motion motion = Pushed({0, 0.03, 0}, 25);
  ASSERT_EQ(Judge(motion), PushVerdict::kFree);
  // from the side, until it touches the arm at the end of the push
  Eigen::VectorXd q = StartOf(motion);
  for (const Pose& X_WE : motion.X_WE) q = kinematics_.Solve(X_WE, q).value_or(q);
  Eigen::Vector3d p = motion.X_WE.back().p + Eigen::Vector3d(0, 0.25, 0);
  for (PutCube(p); !checker_.Check(q) && p.y() > motion.X_WE.back().p.y() - 0.15; PutCube(p)) p.y() -= 0.002;
  EXPECT_EQ(Judge(motion), PushVerdict::kBlocked);
  checker_.Allow({"cube"});
  EXPECT_EQ(Judge(motion), PushVerdict::kFree) << "contact with it is wanted";
}

// 8 mm are kept, as the arm does not come exactly where it is pushed
TEST_F(JudgePushTest, KeepsAMarginThatAContactCheckDoesNot) {
  const plan::Motion motion = Pushed({0, 0.03, 0}, 25);
  Eigen::VectorXd q = StartOf(motion);
  std::vector<Eigen::VectorXd> joints;
  for (int k = 0; k < motion.steps(); ++k) joints.push_back(q = kinematics_.Solve(motion.X_WE[k], q).value_or(q));
  // nearer in half millimetres, until the nearest of all steps has less than 7 mm left
  Eigen::Vector3d p = motion.X_WE[19].p + Eigen::Vector3d(0, 0.25, 0);
  double nearest = 1;
  while (nearest > 0.007) {
    p.y() -= 0.0005;
    PutCube(p);
    nearest = 1;
    for (const auto& at : joints) nearest = std::min(nearest, checker_.Nearest(at).distance);
  }
  ASSERT_GT(nearest, 0.001);
  for (const auto& at : joints) ASSERT_FALSE(checker_.Check(at)) << "it would touch nothing";
  EXPECT_EQ(Judge(motion), PushVerdict::kBlocked);
  p.y() += 0.02;
  PutCube(p);
  EXPECT_EQ(Judge(motion), PushVerdict::kFree);
}

TEST_F(JudgePushTest, WhereTheArmCannotBeIsBlocked) {
  const Eigen::VectorXd any = Eigen::VectorXd::Constant(arm_.q_home.size(), 1e6);
  EXPECT_EQ(Judge(Pushed({0, 3, 0}, 25), any), PushVerdict::kBlocked);
  EXPECT_EQ(JudgePush({}, arm_.q_home, arm_.planned_speed, kinematics_, checker_), PushVerdict::kBlocked)
      << "a push of no steps is none";
}

}  // namespace disturbance_test
}  // namespace etude::task
