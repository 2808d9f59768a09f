// SPDX-License-Identifier: Apache-2.0
// Tests services/episode/viewpoint.cc
#include "services/episode/viewpoint.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

namespace etude {
namespace viewpoint_test {

Camera SomeCamera() {
  Camera camera{.width = 224, .height = 160, .fovy = 0.9};
  camera.X_WC = {{0.1, 1.5, 1.0}, FromEuler({-1.0, 0.05, 3.1})};
  return camera;
}

Eigen::Vector3d DirectionOf(const Viewpoint& viewpoint, const Eigen::Vector2d& pixel) {
  const Eigen::Matrix<float, 3, 3, Eigen::RowMajor> matrix =
      Eigen::Map<const Eigen::Matrix<float, 3, 3, Eigen::RowMajor>>(viewpoint.data() + 3);
  return matrix.cast<double>() * Eigen::Vector3d(pixel.x(), pixel.y(), 1);
}

TEST(ViewpointOf, APixelLooksAtThePointThatItShows) {
  const Camera camera = SomeCamera();
  const Viewpoint viewpoint = ViewpointOf(camera);
  for (const Eigen::Vector3d& p_W :
       {Eigen::Vector3d(0, 0.3, 0.05), Eigen::Vector3d(-0.4, 0.1, 0.3), Eigen::Vector3d(0.35, 0.4, 0.0)}) {
    const Eigen::Vector2d pixel = camera.Project(p_W);
    ASSERT_TRUE(pixel.allFinite());
    const Eigen::Vector3d from(viewpoint[0], viewpoint[1], viewpoint[2]);
    const Eigen::Vector3d way = DirectionOf(viewpoint, pixel);
    const double length = (p_W.z() - from.z()) / way.z();
    EXPECT_GT(length, 0) << "it looks ahead";
    EXPECT_NEAR((from + length * way - p_W).norm(), 0, 1e-5);
  }
}

TEST(ViewpointOf, ACameraIsItsFocalLengthAndItsMiddle) {
  const Camera camera = SomeCamera();
  EXPECT_EQ(ViewpointOf(camera), ViewpointOf(camera.focal(), camera.focal(), 112, 80, camera.X_WC));
  EXPECT_NE(ViewpointOf(camera), ViewpointOf(camera.focal(), camera.focal(), 110, 80, camera.X_WC));
}

}  // namespace viewpoint_test
}  // namespace etude
