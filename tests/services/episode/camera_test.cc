// SPDX-License-Identifier: Apache-2.0
// Tests services/episode/camera.cc
#include "services/episode/camera.h"

#include <gtest/gtest.h>

#include <cmath>

namespace etude {
namespace camera_test {

TEST(Camera, ProjectsTheAxisToTheMiddleAndTheFieldOfViewToTheEdge) {
  Camera camera;
  camera.width = 320;
  camera.height = 240;
  camera.fovy = 1.0;

  // identity pose: looks along -z, x right, y up
  const Eigen::Vector2d middle = camera.Project({0, 0, -2});
  const Eigen::Vector2d top = camera.Project({0, 2 * std::tan(0.5), -2});

  EXPECT_LT((middle - Eigen::Vector2d(160, 120)).norm(), 1e-12);
  EXPECT_NEAR(top.y(), 0, 1e-9);
  EXPECT_NEAR(top.x(), 160, 1e-9);
  EXPECT_GT(camera.Project({0.1, 0, -2}).x(), 160);
}

TEST(Camera, GivesNanBehindTheCamera) {
  const Camera camera;

  EXPECT_TRUE(std::isnan(camera.Project({0, 0, 1}).x()));
}

TEST(Camera, ProjectsThroughItsPose) {
  Camera camera;
  camera.X_WC = {Eigen::Vector3d(1, 2, 3), FromEuler({0.3, -0.4, 0.5})};
  const Eigen::Vector3d p_C(0.2, -0.1, -1.5);

  const Eigen::Vector2d pixel = camera.Project(camera.X_WC * p_C);

  EXPECT_NEAR(pixel.x(), 112 + camera.focal() * 0.2 / 1.5, 1e-9);
  EXPECT_NEAR(pixel.y(), 112 + camera.focal() * 0.1 / 1.5, 1e-9);
}

}  // namespace camera_test
}  // namespace etude
