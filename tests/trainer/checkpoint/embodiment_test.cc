// SPDX-License-Identifier: Apache-2.0
// Tests trainer/checkpoint/embodiment.cc
#include "trainer/checkpoint/embodiment.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace etude::checkpoint {
namespace embodiment_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

Embodiment Example() {
  Episode episode;
  episode.robot = "ur5";
  episode.joint_pos.columns = 6;
  episode.gripper_qpos.columns = 1;
  CameraTrack track;
  track.camera.fovy = 1.0;
  track.camera.X_WC.p = {0.9, 0, 0.8};
  episode.cameras.push_back(track);
  return EmbodimentOf(episode);
}

TEST(Embodiment, IsWhatAnEpisodeShows) {
  const auto embodiment = Example();

  EXPECT_EQ(embodiment.robot, "ur5");
  EXPECT_EQ(embodiment.joints, 7);
  EXPECT_EQ(embodiment.width, 224);
  EXPECT_EQ(embodiment.control_rate, 125);
  EXPECT_EQ(embodiment.horizon, 120);
  EXPECT_EQ(embodiment.camera_pose.size(), 7u);
  EXPECT_FALSE(embodiment.rotation.empty());
  const auto again = FromJson<Embodiment>(ToJson(embodiment), "test");
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_THAT(Differences(embodiment, *again), IsEmpty());
}

TEST(Differences, AreNamedWithBothValues) {
  const auto here = Example();
  const auto with = [&](auto change) {
    auto there = here;
    change(there);
    return Differences(here, there);
  };
  EXPECT_THAT(with([](auto& e) { e.robot = "panda"; }), ElementsAre("robot: ur5 here, panda there"));
  EXPECT_THAT(with([](auto& e) { e.joints = 9; }), ElementsAre("joints: 7 here, 9 there"));
  EXPECT_THAT(with([](auto& e) { e.width = 84; }), ElementsAre("camera width: 224 here, 84 there"));
  EXPECT_THAT(with([](auto& e) { e.height = 84; }), ElementsAre(HasSubstr("camera height")));
  EXPECT_THAT(with([](auto& e) { e.fovy = 0.7; }), ElementsAre(HasSubstr("camera fovy")));
  EXPECT_THAT(with([](auto& e) { e.camera_pose[1] = 0.2; }), ElementsAre(HasSubstr("camera pose")));
  EXPECT_THAT(with([](auto& e) { e.rotation = "other"; }), ElementsAre(HasSubstr("rotation format")));
  EXPECT_THAT(with([](auto& e) { e.control_rate = 100; }), ElementsAre("control rate: 125 here, 100 there"));
  EXPECT_THAT(with([](auto& e) { e.waypoints = 8; }), ElementsAre(HasSubstr("waypoints")));
  EXPECT_THAT(with([](auto& e) { e.horizon = 60; }), ElementsAre(HasSubstr("horizon")));
}

TEST(Differences, AreNoneOfWhatIsNotKnownOrTheSameRotation) {
  const auto here = Example();
  auto there = here;
  for (int i = 3; i < 7; ++i) there.camera_pose[static_cast<std::size_t>(i)] *= -1;
  EXPECT_THAT(Differences(here, there), IsEmpty());
  EXPECT_THAT(Differences(here, Embodiment{}), IsEmpty());
  EXPECT_THAT(Differences(Embodiment{.joints = 7}, here), IsEmpty());
}

}  // namespace embodiment_test
}  // namespace etude::checkpoint
