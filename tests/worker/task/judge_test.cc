// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/judge.cc in the simulation: objects are put where the test wants them.
#include "worker/task/judge.h"

#include <gmock/gmock.h>

#include <map>
#include <numbers>

#include "services/core/rng.h"

namespace etude::task {
namespace judge_test {

constexpr double kQuarter = std::numbers::pi / 2;

class JudgeTest : public testing::Test {
 protected:
  static std::shared_ptr<const sim::Scene> TheScene(const std::string& robot = "ur5") {
    static std::map<std::string, std::shared_ptr<const sim::Scene>> scenes;
    if (!scenes.contains(robot)) {
      SceneSpec spec;
      spec.robot = robot;
      spec.objects = {"coke", "milk"};
      scenes[robot] = sim::Scene::Build(spec).value();
    }
    return scenes[robot];
  }

  JudgeTest() { Stand("coke", {0, 0.35}), Stand("milk", {0.2, 0.35}), world_.Forward(); }

  void Stand(const std::string& name, const Eigen::Vector2d& place, double above = 0.001,
             const Eigen::Vector3d& rpy = Eigen::Vector3d::Zero()) {
    const double height = shapes_.HeightOnTable(name, FromEuler(rpy)) + above;
    world_.SetObject(name, {{place.x(), place.y(), height}, FromEuler(rpy)});
  }
  Judge Make(const std::string& task, std::vector<std::string> avoid = {}) {
    auto made = Judge::Make({CriteriaOf(ParseTask(task).value()), "coke", "milk", std::move(avoid)}, world_, shapes_,
                            &checker_);
    EXPECT_TRUE(made.has_value()) << made.error().message;
    return std::move(*made);
  }
  void Stay(Judge& judge, int steps) {
    for (int t = 0; t < steps; ++t) {
      world_.Step(here_, Eigen::Matrix<double, 6, 1>::Zero());
      judge.Observe(world_);
    }
  }

  std::shared_ptr<const sim::Scene> scene_ = TheScene();
  sim::World world_{scene_};
  sim::Kinematics kinematics_{scene_};
  SceneGeometry shapes_{*scene_, kinematics_};
  collide::Checker checker_{scene_};
  Waypoint here_{world_.X_WE(), 0};
};

TEST_F(JudgeTest, PushIsDoneAfterFiftyStepsInARowAtRest) {
  Judge judge = Make("push");
  Stay(judge, 20);
  EXPECT_EQ(judge.held(), 0);
  Stand("coke", {0, 0.40});
  world_.Forward();
  Stay(judge, 20);  // the first of these is a jump of 5 cm: not at rest
  EXPECT_TRUE(judge.success_latched());
  const int held = judge.held();
  EXPECT_GT(held, 10);
  Stand("coke", {0, 0.36});  // back: the count begins anew
  world_.Forward();
  Stay(judge, 5);
  EXPECT_EQ(judge.held(), 0);
  Stand("coke", {0, 0.40});
  world_.Forward();
  Stay(judge, 40);
  EXPECT_FALSE(judge.done());
  Stay(judge, 20);
  EXPECT_TRUE(judge.done() && judge.success()) << judge.Words();
}

TEST_F(JudgeTest, SuccessImpliesLatchedWhateverTheStrictConditionSays) {
  Judge judge = Make("put_down");
  Stand("coke", {0, 0.35}, 0.001, {kQuarter, 0, 0});  // pushed over: lies, released, at rest, was never lifted
  world_.Forward();
  Stay(judge, 200);
  EXPECT_FALSE(judge.success_latched());
  EXPECT_FALSE(judge.done());
  Stand("coke", {0, 0.35}, 0.15, {kQuarter, 0, 0});  // and now from 15 cm up
  world_.Forward();
  Stay(judge, 200);
  EXPECT_TRUE(judge.success_latched());
  EXPECT_TRUE(judge.success()) << judge.Words();
}

TEST_F(JudgeTest, ContactWithWhatIsToBeAvoidedIsAViolationAndEndsNothing) {
  Judge judge = Make("push+others", {"milk"});
  Stand("milk", {0.04 + 0.02, 0.40});
  Stand("coke", {0.02, 0.40});
  world_.Forward();
  Stay(judge, 120);
  ASSERT_THAT(judge.violations(), testing::Not(testing::IsEmpty()));
  const Violation& first = judge.violations().front();
  EXPECT_EQ(first.kind, Violation::Kind::kContact);
  EXPECT_EQ(first.what, "coke-milk");
  for (std::size_t i = 1; i < judge.violations().size(); ++i)
    EXPECT_GT(judge.violations()[i].step, judge.violations()[i - 1].step) << "one entry, however many points touch";
  EXPECT_TRUE(judge.success_latched());
  EXPECT_FALSE(judge.success());
  EXPECT_THAT(judge.disturbed(), testing::ElementsAre("milk"));
  const OrderedJson report = judge.Report();
  EXPECT_EQ(report["violations"][0]["kind"], "contact");
  EXPECT_EQ(report["violations"][0]["step"], first.step);
}

TEST_F(JudgeTest, AFastJointIsAViolationWithItsStepAndName) {
  Judge judge = Make("pick");
  Stay(judge, 10);
  EXPECT_TRUE(judge.violations().empty());
  here_.X_WE.p += Eigen::Vector3d(0, 0, 0.4);
  world_.Step(here_, (Eigen::Matrix<double, 6, 1>() << 0, 0, 9, 0, 9, 9).finished());
  judge.Observe(world_);
  for (int t = 0; t < 40; ++t) {
    world_.Step(here_, (Eigen::Matrix<double, 6, 1>() << 0, 0, 9, 0, 9, 9).finished());
    judge.Observe(world_);
  }
  bool fast = false, strained = false;
  for (const auto& violation : judge.violations()) {
    EXPECT_GE(violation.step, 10);
    if (violation.kind == Violation::Kind::kJointSpeed) fast |= violation.worst > kSpeedShare;
    if (violation.kind == Violation::Kind::kTorque) {
      strained = true;
      EXPECT_GT(violation.steps, kTorqueSteps);
    }
  }
  EXPECT_TRUE(fast);
  EXPECT_TRUE(strained);
}

TEST_F(JudgeTest, TheArmInItselfIsAViolationThatTheSimulationDoesNotSee) {
  // a configuration in which two bodies are a centimetre in each other
  Rng rng(5);
  Eigen::VectorXd q = scene_->arm().q_home;
  const auto overlaps = [&] { return checker_.SelfOverlaps(kinematics_.ArmPoses(q, 0), 0.01); };
  for (int i = 0; i < 1000 && overlaps().empty(); ++i)
    for (Eigen::Index joint = 1; joint < q.size(); ++joint) q[joint] = rng.Uniform(-3, 3);
  ASSERT_FALSE(overlaps().empty()) << "no fold of the arm touches";
  world_.SetArm(q);
  world_.Forward();
  here_.X_WE = world_.X_WE();
  Judge judge = Make("pick");
  Stay(judge, 3);
  ASSERT_FALSE(judge.violations().empty());
  const Violation& violation = judge.violations().front();
  EXPECT_EQ(violation.kind, Violation::Kind::kSelfContact);
  EXPECT_EQ(violation.step, 0);
  EXPECT_GT(violation.worst, kSelfContactDepth);
  EXPECT_TRUE(std::ranges::any_of(judge.violations(), [](const Violation& one) { return one.steps >= 3; }))
      << "one entry for a run of steps";
}

TEST_F(JudgeTest, HomeOfEveryRobotIsWithoutViolation) {
  for (const char* robot : {"ur5", "panda", "jaco2"}) {
    const auto scene = TheScene(robot);
    sim::World world(scene);
    collide::Checker checker(scene);
    EXPECT_TRUE(checker.SelfOverlaps(world.ArmPoses(), kSelfContactDepth).empty()) << robot;
    EXPECT_FALSE(checker.SelfPairs().empty()) << robot;
  }
}

TEST_F(JudgeTest, WhatSomebodyElseMovedCountsFromWhereItCameTo) {
  Judge judge = Make("push");
  Stay(judge, 5);
  Stand("coke", {0, 0.45});
  world_.Forward();
  judge.Displaced(world_, "coke");
  Stay(judge, 60);
  EXPECT_FALSE(judge.success_latched()) << "the robot did not push it";
  Stand("coke", {0, 0.50});
  world_.Forward();
  Stay(judge, 80);
  EXPECT_TRUE(judge.success());
}

}  // namespace judge_test
}  // namespace etude::task
