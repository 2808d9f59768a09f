// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/primitives for hands that come from above: above_hand.cc and the primitives' goals, against the
// places of the hand's and the objects' own pieces.
#include "worker/task/primitives/above_hand.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "tests/support/sketch_robot.h"
#include "tests/worker/task/stages_fixture.h"
#include "worker/task/task_stages.h"

namespace etude::task {
namespace above_hand_test {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using Part = SceneGeometry::Part;

constexpr double kRounding = 1e-9;
const Vector3d kDown(0, 0, -1);

struct Robot {
  std::shared_ptr<const sim::Scene> scene;
  std::shared_ptr<sim::Kinematics> kinematics;
  std::shared_ptr<const SceneGeometry> shapes;
};

// "sketch" has five joints. Built once each.
const Robot& RobotOf(const std::string& name) {
  static std::map<std::string, Robot> robots;
  Robot& robot = robots[name];
  if (robot.scene) return robot;
  SceneSpec spec;
  static SketchRobot sketch;
  if (name == "sketch") sketch.WithoutRoll();
  spec.robot = name == "sketch" ? sketch.yaml() : name;
  robot.scene = sim::Scene::Build(spec).value();
  robot.kinematics = std::make_shared<sim::Kinematics>(robot.scene);
  robot.shapes = std::make_shared<SceneGeometry>(*robot.scene, *robot.kinematics);
  return robot;
}

class AboveHand : public testing::TestWithParam<const char*> {
 protected:
  AboveHand() { now_.shapes = &shapes_; }

  std::vector<Stage> StagesFor(const std::string& task) const { return StagesOf(ParseTask(task).value(), shapes_); }
  // The target upright on the table, the hand far from it.
  void Stand(const std::string& target) {
    now_.target = target;
    now_.X_WO = {{0.1, 0.3, shapes_.object(target).rest_height}, Quaterniond::Identity()};
    now_.X_WE = {{-0.2, 0.2, 0.4}, Hand(shapes_.natural_pitch())};
    now_.X_EO.reset();
  }
  // The target in the hand that stands at `X_WE`.
  void Hold(const Pose& X_WE) {
    now_.X_EO = X_WE.inverse() * now_.X_WO;
    now_.X_WE = X_WE;
  }
  double Lowest(Part part, bool closed, const Pose& X_WE) const {
    return X_WE.p.z() - shapes_.Reach(part, closed, X_WE.q, kDown);
  }
  // Height of the held target's lowest point over the table, the hand being at X_WE.
  double HeldOver(const Pose& X_WE) const {
    const Pose X_WO = X_WE * *now_.X_EO;
    return X_WO.p.z() - shapes_.HeightOnTable(now_.target, X_WO.q);
  }
  double Top() const { return now_.X_WO.p.z() - shapes_.object(now_.target).rest_height + Height(now_.target); }
  double Height(const std::string& object) const { return 2 * shapes_.object(object).half_extent.z(); }

  const Robot& robot_ = RobotOf(GetParam());
  const SceneGeometry& shapes_ = *robot_.shapes;
  StageContext now_;
};

TEST_P(AboveHand, GraspsBelowTheTopAndOffTheTable) {
  const auto stages = StagesFor("pick");
  for (const auto& object : robot_.scene->objects()) {
    Stand(object.name);
    const Pose grasp = FindStage(stages, "reach").goal(now_);
    EXPECT_NEAR(above::TopOfTarget(now_), Top(), 1e-6) << object.name;
    EXPECT_LT(Lowest(Part::kFingers, true, grasp), Top()) << object.name;
    EXPECT_GE(grasp.p.z() - shapes_.FurthestReach(grasp.q, kDown), kAbove.finger_gap - kRounding) << object.name;
    // the line that the fingertips come along meets the object's axis within the pads
    const Vector3d a = -(grasp.q * Vector3d::UnitX());
    const Vector3d tips = grasp.p + shapes_.ahead_closed() * a;
    EXPECT_NEAR((tips - now_.X_WO.p).head<2>().norm(), kAbove.pad_beyond * a.head<2>().norm(), kRounding);
    if (shapes_.natural_pitch() > kAbove.vertical) {
      EXPECT_GE(grasp.p.z() + shapes_.palm_ahead() * a.z(), Top() + kAbove.palm_gap - kRounding) << object.name;
    }
  }
}

TEST_P(AboveHand, ApproachesAlongTheLineOfTheGraspWithItsFingersOverTheTop) {
  const auto stages = StagesFor("pick");
  for (const auto& object : robot_.scene->objects()) {
    Stand(object.name);
    const Pose grasp = FindStage(stages, "reach").goal(now_);
    const Pose before = FindStage(stages, "approach").goal(now_);
    const Vector3d back = before.p - grasp.p, a = -(grasp.q * Vector3d::UnitX());
    EXPECT_LT(back.cross(a).norm(), kRounding) << "beside the line";
    EXPECT_GE(-back.dot(a), kAbove.least_back - kRounding);
    EXPECT_GE(Lowest(Part::kFingers, false, before), Top() + kAbove.hover - kRounding) << object.name;
    EXPECT_LT(AngleBetween(before.q, grasp.q), 1e-7);

    // a hand that is on its way already is not sent back
    now_.X_WE = {grasp.p - 0.9 * -back.dot(a) * a, grasp.q};
    EXPECT_LE((FindStage(stages, "approach").goal(now_).p - grasp.p).norm(),
              std::max((now_.X_WE.p - grasp.p).norm(), -back.dot(a) - kAbove.hover_slack) + kRounding);
  }
}

TEST_P(AboveHand, LiftsUntilThereIsRoomAndNeverDown) {
  const auto stages = StagesFor("pick");
  for (const auto& object : robot_.scene->objects()) {
    Stand(object.name);
    Hold(FindStage(stages, "reach").goal(now_));
    const Pose lifted = FindStage(stages, "lift").goal(now_);
    EXPECT_GE(HeldOver(lifted), LiftSpec{}.room - kRounding) << object.name;
    EXPECT_EQ((lifted.p - now_.X_WE.p).head<2>().norm(), 0) << "straight up";
    now_.X_WE.p.z() = 0.5;
    EXPECT_EQ(FindStage(stages, "lift").goal(now_).p.z(), 0.5);
  }
}

TEST_P(AboveHand, PushesLowFromBehindAndFarEnough) {
  const auto stages = StagesFor("push");
  const PushSpec spec;
  for (const auto& object : robot_.scene->objects()) {
    Stand(object.name);
    const Stage& push = FindStage(stages, "push");
    const Pose behind = FindStage(stages, "approach").goal(now_), end = push.goal(now_), nearer = push.nearer(now_);
    const double face = now_.X_WO.p.y() - object.half_extent.y();  // towards the robot
    const auto tips = [&](const Pose& X_WE) {
      return X_WE.p.y() + shapes_.Reach(Part::kFingers, true, X_WE.q, Vector3d::UnitY());
    };
    EXPECT_NEAR(tips(behind), face - kAbove.push_behind, kRounding) << object.name;
    EXPECT_NEAR(tips(end), face + spec.distance, kRounding);
    EXPECT_NEAR(tips(nearer), face + spec.least, kRounding);
    for (const Pose& X_WE : {behind, end, nearer}) {
      EXPECT_EQ(X_WE.p.x(), now_.X_WO.p.x()) << "in line with it";
      EXPECT_GE(Lowest(Part::kHand, true, X_WE), kAbove.push_height - kRounding) << "off the table";
      EXPECT_LE(Lowest(Part::kHand, true, X_WE), std::max(kAbove.push_highest * Top(), kAbove.push_height) + kRounding)
          << object.name << " would tip over";
      EXPECT_LT(AngleBetween(X_WE.q, behind.q), 1e-7);
    }
  }
}

TEST_P(AboveHand, SetsDownWhatItHoldsWithAGapUnderIt) {
  const auto stages = StagesFor("place_left");
  now_.reference = "milk";
  now_.X_WR = {{-0.1, 0.3, shapes_.object("milk").rest_height}, Quaterniond::Identity()};
  const double gap = PlaceSpec{}.gap;
  for (const auto& object : robot_.scene->objects()) {
    if (object.name == "milk") continue;
    Stand(object.name);
    Hold(FindStage(stages, "reach").goal(now_));
    const Pose carried = FindStage(stages, "carry").goal(now_);
    EXPECT_GE(HeldOver(carried), CarrySpec{}.room - kRounding) << object.name;
    now_.X_WE = carried;
    const Pose placed = FindStage(stages, "place").goal(now_);
    EXPECT_LT((placed.p - carried.p).head<2>().norm(), kRounding) << "straight down";
    const Pose X_WO = placed * *now_.X_EO;
    const Vector3d beside = X_WO.p - now_.X_WR.p;
    EXPECT_GE(beside.x(), kAbove.beside - kRounding) << object.name << ": left is +x";
    EXPECT_LE(beside.x(), kAbove.beside_most + kRounding) << object.name;
    EXPECT_NEAR(beside.y(), 0, kRounding);
    const double over = HeldOver(placed), hand = placed.p.z() - shapes_.FurthestReach(placed.q, kDown);
    EXPECT_GE(over, gap - kRounding) << object.name;
    EXPECT_GE(hand, kAbove.finger_gap - kRounding) << object.name;
    EXPECT_TRUE(over < gap + kRounding || hand < kAbove.finger_gap + kRounding) << "no lower than one of them allows";
  }
}

TEST_P(AboveHand, EachSideOfTheReferenceIsThatOfThePicture) {
  now_.reference = "milk";
  now_.X_WR = {{0, 0.32, shapes_.object("milk").rest_height}, Quaterniond::Identity()};
  const std::map<std::string, Vector3d> sides{
      {"place_left", {1, 0, 0}}, {"place_right", {-1, 0, 0}}, {"place_front", {0, 1, 0}}, {"place_behind", {0, -1, 0}}};
  for (const auto& [task, side] : sides) {
    const auto stages = StagesFor(task);
    Stand("cube");
    Hold(FindStage(stages, "reach").goal(now_));
    const Pose X_WO = FindStage(stages, "carry").goal(now_) * *now_.X_EO;
    const Vector3d beside = X_WO.p - now_.X_WR.p;
    EXPECT_GT(beside.dot(side), 0.1) << task;
    EXPECT_LT(beside.head<2>().cwiseAbs().minCoeff(), kRounding) << task << ": nothing aside";
  }
}

TEST_P(AboveHand, StacksOnTheTopOfTheReference) {
  const auto stages = StagesFor("stack");
  now_.reference = "cube";
  now_.X_WR = {{-0.1, 0.3, shapes_.object("cube").rest_height}, Quaterniond::Identity()};
  Stand("coke");
  Hold(FindStage(stages, "reach").goal(now_));
  const Pose carried = FindStage(stages, "carry").goal(now_);
  EXPECT_GE(HeldOver(carried), Height("cube") + kAbove.over_reference - kRounding);
  now_.X_WE = carried;
  const Pose placed = FindStage(stages, "place").goal(now_);
  EXPECT_LT(((placed * *now_.X_EO).p - now_.X_WR.p).head<2>().norm(), kRounding);
  EXPECT_GE(HeldOver(placed), Height("cube") + 0.004 - 1e-6) << "the file's gap";
  EXPECT_LE(HeldOver(placed), Height("cube") + 0.05);
  EXPECT_TRUE(FindStage(stages, "place").nears_reference);
}

TEST_P(AboveHand, LeavesAStackTheWayItCame) {
  const auto stages = StagesFor("stack");
  now_.reference = "cube";
  Stand("coke");
  now_.X_WE = FindStage(stages, "reach").goal(now_);
  const Vector3d left = FindStage(stages, "retreat").goal(now_).p - now_.X_WE.p;
  EXPECT_NEAR(left.norm(), RetreatSpec{}.distance, kRounding);
  EXPECT_LT(left.cross(now_.X_WE.q * Vector3d::UnitX()).norm(), kRounding);
  EXPECT_GT(left.z(), 0);
}

TEST_P(AboveHand, TurnsWithRoomUnderWhatItHolds) {
  if (!shapes_.turns_any_way()) GTEST_SKIP() << "not for five joints";
  const auto stages = StagesFor("put_down");
  for (const auto& object : robot_.scene->objects()) {
    Stand(object.name);
    Hold(FindStage(stages, "reach").goal(now_));
    now_.X_WE = FindStage(stages, "lift").goal(now_);
    const Pose turned = FindStage(stages, "turn").goal(now_);
    EXPECT_GE(HeldOver(turned), kAbove.turned_below - kRounding) << object.name;
    EXPECT_NEAR(AngleBetween(turned.q, now_.X_WE.q), M_PI / 2, 0.3) << "a quarter of a turn, less what it leans";
    // half way round, what is left of the way is the same place
    const Pose half{turned.p + 0.5 * (now_.X_WE.p - turned.p), now_.X_WE.q.slerp(0.5, turned.q)};
    now_.X_WE = half;
    EXPECT_LT((FindStage(stages, "turn").goal(now_).p - turned.p).head<2>().norm(), 1e-6) << object.name;
  }
}

TEST_P(AboveHand, DetoursGoOverAndNoneOfItsStagesIsFasterThanItsSlowestJoint) {
  for (const char* task : {"pick", "push", "put_down", "place_left", "stack"})
    for (const Stage& stage : StagesFor(task)) {
      EXPECT_TRUE(stage.detours_over) << task << " " << stage.name;
      if (!stage.moves()) continue;
      EXPECT_GT(stage.limits.joint, 0);
      EXPECT_LT(stage.limits.joint, shapes_.joint_speed()) << "what follows a motion is a little faster";
    }
}

INSTANTIATE_TEST_SUITE_P(Robots, AboveHand, testing::Values("panda", "jaco2", "sketch"),
                         [](const auto& info) { return std::string(info.param); });

}  // namespace above_hand_test
}  // namespace etude::task
