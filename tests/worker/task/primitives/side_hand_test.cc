// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/primitives for a hand that comes from the side.
#include "worker/task/primitives/side_hand.h"

#include <gtest/gtest.h>

#include "tests/worker/task/stages_fixture.h"
#include "worker/task/primitives/tuning.h"
#include "worker/task/task_stages.h"

namespace etude::task {
namespace side_hand_test {

class SideHand : public testing::Test {
 protected:
  SideHand() { now_.shapes = &shapes_; }

  // The target stands on the table, in a level hand that is so far above its origin.
  void Hold(const std::string& target, double above) {
    now_.target = target;
    const Pose X_WO{{0.1, 0.4, shapes_.object(target).rest_height}, Eigen::Quaterniond::Identity()};
    now_.X_WE = {X_WO.p + Eigen::Vector3d(0, 0, above), LevelHand()};
    now_.X_EO = now_.X_WE.inverse() * X_WO;
  }
  double HeldOver(const Pose& X_WE) const {
    const Pose X_WO = X_WE * *now_.X_EO;
    return X_WO.p.z() - shapes_.HeightOnTable(now_.target, X_WO.q);
  }

  const std::shared_ptr<const sim::Scene> scene_ = sim::Scene::Build(SceneSpec()).value();
  sim::Kinematics kinematics_{scene_};
  const SceneGeometry shapes_{*scene_, kinematics_};
  StageContext now_;
};

// their demonstrations are those of every version
TEST_F(SideHand, LiftsTheObjectsThatComeAlongToOneHeight) {
  const auto stages = StagesOf(ParseTask("pick").value(), shapes_);
  for (const auto& object : scene_->objects()) {
    Hold(object.name, kSide.grasp_above);
    EXPECT_EQ(FindStage(stages, "lift").goal(now_).p.z(), kSide.lift_height) << object.name;
  }
}

// a bottle of 30 cm was to be lifted to where the hand already was, or below
TEST_F(SideHand, LiftsWhatIsTallerUntilThereIsRoomUnderIt) {
  const auto stages = StagesOf(ParseTask("put_down").value(), shapes_);
  Hold("bottle", 0.12);
  for (const char* stage : {"lift", "turn"}) {
    const Pose goal = FindStage(stages, stage).goal(now_);
    EXPECT_GE(HeldOver({goal.p, now_.X_WE.q}), kSide.lift_room - 1e-9) << stage;
    EXPECT_GT(goal.p.z(), now_.X_WE.p.z()) << stage;
  }
}

// its closed fingers began within the box
TEST(SideHandOf, ADeepObjectIsPushedFromBehindItsFace) {
  SceneSpec spec;
  spec.objects = {"cube", "open_box"};
  const auto scene = sim::Scene::Build(spec).value();
  sim::Kinematics kinematics(scene);
  const SceneGeometry shapes(*scene, kinematics);
  const auto approach = FindStage(StagesOf(ParseTask("push").value(), shapes), "approach");
  StageContext now;
  now.shapes = &shapes;
  now.X_WE = {{0.4, 0.4, 0.3}, LevelHand()};
  const auto tips = [&](const std::string& target) {
    now.target = target;
    now.X_WO = {{0.1, 0.3, shapes.object(target).rest_height}, Eigen::Quaterniond::Identity()};
    return approach.goal(now).p.y() + shapes.ahead_closed();
  };
  EXPECT_LT(tips("open_box"), 0.3 - shapes.object("open_box").half_extent.y() - 0.008);
  EXPECT_NEAR(tips("cube"), 0.3 - kSide.behind + shapes.ahead_closed() - shapes.ahead_open(), 1e-12) << "as ever";
}

}  // namespace side_hand_test
}  // namespace etude::task
