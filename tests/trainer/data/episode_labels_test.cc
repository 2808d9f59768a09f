// SPDX-License-Identifier: Apache-2.0
// Tests trainer/data/episode_labels.cc
#include "trainer/data/episode_labels.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/synthetic_episode.h"

namespace etude::data {
namespace {

// commands whose x is the step: 0, 1, 2, ... metres; gripper closes at step 30
Episode Ramp(int steps) {
  Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 0, steps);
  episode.actions_abs.values.clear();
  for (int t = 0; t < steps; ++t)
    for (double value : {1.0 * t, 0.0, 0.5, 0.1 * t, 0.0, 0.0, t >= 30 ? 1.0 : 0.0})
      episode.actions_abs.values.push_back(static_cast<float>(value));
  return episode;
}

float At(const TrajectoryLabel& label, int waypoint, int column) {
  return label.values[waypoint * kWaypointSize + column];
}

TEST(LabelTrajectory, ReadsTheCommandsAheadAtTheWaypointsSteps) {
  const TrajectoryLabel label = LabelTrajectory(Ramp(200), 7);

  for (int k = 0; k < kWaypoints; ++k) {
    EXPECT_NEAR(At(label, k, 0), 7 + k * 119.0 / 11, 1e-3) << k;
    const double roll = 0.1 * (7 + k * 119.0 / 11);
    EXPECT_NEAR(At(label, k, 3), std::sin(roll), 1e-4) << k;
    EXPECT_NEAR(At(label, k, 4), std::cos(roll), 1e-4) << k;
    EXPECT_TRUE(label.valid[k]);
  }
  EXPECT_EQ(At(label, 2, 9), 0);  // step 28.6: still open
  EXPECT_EQ(At(label, 3, 9), 1);  // step 39.5
}

TEST(LabelTrajectory, HoldsTheLastCommandBehindTheEnd) {
  const TrajectoryLabel label = LabelTrajectory(Ramp(50), 40);

  EXPECT_NEAR(At(label, 0, 0), 40, 1e-4);
  for (int k = 1; k < kWaypoints; ++k) {
    EXPECT_NEAR(At(label, k, 0), 49, 1e-4);
    EXPECT_TRUE(label.valid[k]);
  }
}

TEST(LabelTrajectory, MasksWaypointsBehindADisturbance) {
  Episode episode = Ramp(200);
  episode.supervise[40] = 0;

  const TrajectoryLabel before = LabelTrajectory(episode, 10);
  const TrajectoryLabel during = LabelTrajectory(episode, 40);
  const TrajectoryLabel after = LabelTrajectory(episode, 41);

  // waypoints at 10, 20.8, 31.6, 42.5, ...
  for (int k = 0; k < kWaypoints; ++k) {
    EXPECT_EQ(before.valid[k], k <= 2) << k;
    EXPECT_FALSE(during.valid[k]);
    EXPECT_TRUE(after.valid[k]);
  }
}

TEST(LabelObject, ProjectsExactly) {
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(224, 224), 3);
  const Camera& camera = episode.cameras[0].camera;
  for (const int step : {0, 20, 45}) {
    for (const auto& object : episode.objects) {
      const PointLabel label = LabelObject(object, step);
      const auto pose = object.pose.row(step);
      const Eigen::Vector2d pixel = camera.Project({pose[0], pose[1], pose[2]});
      EXPECT_NEAR(label.pixel[0], pixel.x(), 1e-3);
      EXPECT_NEAR(label.pixel[1], pixel.y(), 1e-3);
      for (int i = 0; i < 3; ++i) EXPECT_EQ(label.pose[i], pose[i]);
      EXPECT_EQ(label.pose[4], 1);  // cos(roll) of an upright object
    }
  }
}

TEST(LabelHand, GivesPositionAndOrientation) {
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 3);
  const PointLabel label = LabelHand(episode, 11);

  for (int i = 0; i < 3; ++i) EXPECT_EQ(label.pose[i], episode.eef_pos.row(11)[i]);
  EXPECT_NEAR(label.pose[3], 0, 1e-6);  // turned by pi about x: sin and cos of roll
  EXPECT_NEAR(label.pose[4], -1, 1e-6);
}

}  // namespace
}  // namespace etude::data
