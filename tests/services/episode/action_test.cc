// SPDX-License-Identifier: Apache-2.0
// Tests services/episode/action.cc
#include "services/episode/action.h"

#include <gtest/gtest.h>

namespace etude {
namespace action_test {

std::vector<Waypoint> Line() {
  std::vector<Waypoint> waypoints(kWaypoints);
  for (int k = 0; k < kWaypoints; ++k) {
    waypoints[k].X_WE.p = {0.1 * k, -0.2 * k, 1};
    waypoints[k].X_WE.q = FromEuler({0, 0, 0.1 * k});
    waypoints[k].gripper = k >= 6 ? 1 : 0;
  }
  return waypoints;
}

TEST(Waypoint, SurvivesItsVector) {
  const Waypoint waypoint{{Eigen::Vector3d(0.1, 0.2, 0.3), FromEuler({3.0, -0.4, 0.5})}, 0.75};

  const Waypoint back = FromVector(ToVector(waypoint).data());

  EXPECT_LT((back.X_WE.p - waypoint.X_WE.p).norm(), 1e-6);
  EXPECT_LT(AngleBetween(back.X_WE.q, waypoint.X_WE.q), 1e-5);
  EXPECT_FLOAT_EQ(back.gripper, 0.75f);
}

TEST(Waypoint, VectorHasTheFirstTwoColumnsOfTheRotation) {
  const Eigen::Quaterniond q = FromEuler({0.3, -0.4, 0.5});
  const auto values = ToVector({{Eigen::Vector3d::Zero(), q}, 0});
  const Eigen::Matrix3d R = q.toRotationMatrix();

  for (int i = 0; i < 3; ++i) {
    EXPECT_FLOAT_EQ(values[3 + i], static_cast<float>(R(i, 0)));
    EXPECT_FLOAT_EQ(values[6 + i], static_cast<float>(R(i, 1)));
  }
}

TEST(Interpolate, PassesThroughTheWaypointsAndIsLinearBetween) {
  const auto line = Line();

  for (int k = 0; k < kWaypoints; ++k)
    EXPECT_LT((Interpolate(line, WaypointStep(k)).X_WE.p - line[k].X_WE.p).norm(), 1e-9) << k;
  const Waypoint between = Interpolate(line, 2.5 * WaypointStep(1));
  EXPECT_LT((between.X_WE.p - Eigen::Vector3d(0.25, -0.5, 1)).norm(), 1e-9);
  EXPECT_LT(AngleBetween(between.X_WE.q, FromEuler({0, 0, 0.25})), 1e-9);
}

TEST(Interpolate, HoldsTheGripperUntilItsWaypointAndClampsTheEnds) {
  const auto line = Line();

  EXPECT_EQ(Interpolate(line, WaypointStep(6) - 0.01).gripper, 0);
  EXPECT_EQ(Interpolate(line, WaypointStep(6) + 0.01).gripper, 1);
  EXPECT_LT((Interpolate(line, 1000).X_WE.p - line.back().X_WE.p).norm(), 1e-9);
  EXPECT_LT((Interpolate(line, -5).X_WE.p - line.front().X_WE.p).norm(), 1e-9);
}

}  // namespace action_test
}  // namespace etude
