// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/effort.cc and worker/task/motion_check.cc
#include "worker/task/effort.h"

#include <gmock/gmock.h>

#include "tests/support/sketch_robot.h"
#include "worker/task/motion_check.h"

namespace etude::task {
namespace effort_test {

using Vector6 = Eigen::Matrix<double, 6, 1>;

std::shared_ptr<const sim::Scene> SceneWith(const std::string& robot) {
  SceneSpec spec;
  spec.robot = robot;
  spec.objects = {"cube"};
  auto scene = sim::Scene::Build(spec);
  EXPECT_TRUE(scene) << scene.error().message;
  return *scene;
}

TEST(Effort, CountsTheStepsBeyondAJointsTorque) {
  SketchRobot robot;
  robot.InMjcf("kp=\"2000\" forcerange=\"-120 120\"", "kp=\"2000\" forcerange=\"-8 8\"");  // the first: turn
  sim::World world(SceneWith(robot.yaml()));
  Effort effort;
  const Pose home = world.X_WE();
  for (int i = 0; i < 10; ++i) {
    world.Step({home, 0}, Vector6::Zero());
    effort.Observe(world, "");
  }
  EXPECT_THAT(effort.Saturated(), testing::IsEmpty()) << "it can hold its home";
  Pose far = home;
  far.p += Eigen::Vector3d(0.3, 0, 0);  // at once: more than any joint has
  int beyond = 0;
  for (int i = 0; i < 10; ++i) {
    world.Step({far, 0}, Vector6::Zero());
    effort.Observe(world, "");
    beyond += std::abs(world.demanded_torque()[0]) > world.scene().arm().torque_limit[0];
  }
  ASSERT_GT(beyond, 0);
  const auto saturated = effort.Saturated();
  ASSERT_FALSE(saturated.empty());
  EXPECT_EQ(effort.steps(), 20);
  for (std::size_t i = 1; i < saturated.size(); ++i) EXPECT_GE(saturated[i - 1].steps, saturated[i].steps);
  const auto turn = std::ranges::find(saturated, "turn", &Effort::Joint::name);
  ASSERT_NE(turn, saturated.end());
  EXPECT_EQ(turn->steps, beyond);
  EXPECT_EQ(turn->limit, 8);
  EXPECT_GT(turn->demand, 8);
}

TEST(Effort, NamesWhatIsTouchedUnlessItIsWanted) {
  sim::World world(SceneWith("deploy/robots/sketch.yaml"));
  const Pose home = world.X_WE();
  Effort unwanted, wanted;
  const auto press = [&](double x) {  // down, into the table
    Pose low = home;
    low.p.x() += x;
    for (const double z : {home.p.z(), -0.02})
      for (int i = 0; i < 150; ++i) {
        low.p.z() = z;
        world.Step({low, 0}, Vector6::Zero());
        unwanted.Observe(world, "");
        wanted.Observe(world, "cube");
      }
  };
  world.SetObject("cube", {{home.p.x(), home.p.y(), 0.05}, Eigen::Quaterniond::Identity()});
  world.Forward();
  press(0);
  press(0.2);
  const auto others = [](const Effort& effort) {
    std::vector<std::string> names;
    for (const auto& touch : effort.Touches()) names.push_back(touch.other);
    return names;
  };
  EXPECT_THAT(others(unwanted), testing::Contains("cube"));
  EXPECT_THAT(others(wanted), testing::Not(testing::Contains("cube")));
  EXPECT_THAT(others(wanted), testing::Contains("world"));
}

TEST(Effort, AddsUp) {
  Effort sum, one;
  one.Add({{.kind = Violation::Kind::kSelfContact, .what = "hand-foot", .steps = 2},
           {.kind = Violation::Kind::kTorque, .what = "turn", .steps = 20}});
  sum.Add(one);
  sum.Add(one);
  ASSERT_EQ(sum.Touches().size(), 1u);
  EXPECT_EQ(sum.Touches()[0].body, "hand-foot");
  EXPECT_EQ(sum.Touches()[0].steps, 4);
}

TEST(MotionCheck, ArmsThatComeAlongFollow) {
  for (const char* robot : {"ur5", "panda", "jaco2", "deploy/robots/sketch.yaml"}) {
    const MotionCheck check = CheckMotion(SceneWith(robot));
    EXPECT_GE(check.motions, 6) << robot;
    EXPECT_LT(check.lag, 0.02) << robot << ": " << check.worst;
    EXPECT_LT(check.rest, 1e-3) << robot;
    EXPECT_TRUE(check.healthy) << robot;
    EXPECT_THAT(check.effort.Saturated(), testing::IsEmpty()) << robot;
    EXPECT_THAT(check.effort.Touches(), testing::IsEmpty()) << robot;
  }
}

TEST(MotionCheck, NamesTheJointThatIsTooWeak) {
  SketchRobot robot;
  robot.InMjcf("<position joint=\"bend\" kp=\"2000\" forcerange=\"-120 120\"/>",
               "<position joint=\"bend\" kp=\"2000\" forcerange=\"-5 5\"/>");
  const auto saturated = CheckMotion(SceneWith(robot.yaml())).effort.Saturated();
  ASSERT_FALSE(saturated.empty());
  EXPECT_EQ(saturated[0].name, "bend");
}

}  // namespace effort_test
}  // namespace etude::task
