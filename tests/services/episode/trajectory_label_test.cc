// SPDX-License-Identifier: Apache-2.0
// Tests services/episode/trajectory_label.cc
#include "services/episode/trajectory_label.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/synthetic_episode.h"

namespace etude {
namespace trajectory_label_test {

// commands whose x is the step: 0, 1, 2, ... metres; gripper closes at step 30
Episode Ramp(int steps) {
  Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 0, steps);
  episode.actions_abs.values.clear();
  for (int t = 0; t < steps; ++t)
    episode.actions_abs.Push(ToVector({{{1.0 * t, 0, 0.5}, FromEuler({0.1 * t, 0, 0})}, t >= 30 ? 1.0 : 0.0}));
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
    EXPECT_NEAR(At(label, k, 3), 1, 1e-6) << k;  // a turn about x leaves the first column
    EXPECT_NEAR(At(label, k, 7), std::cos(roll), 1e-4) << k;
    EXPECT_NEAR(At(label, k, 8), std::sin(roll), 1e-4) << k;
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

}  // namespace trajectory_label_test
}  // namespace etude
