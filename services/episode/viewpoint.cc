// SPDX-License-Identifier: Apache-2.0
#include "services/episode/viewpoint.h"

namespace etude {

Viewpoint ViewpointOf(double fx, double fy, double cx, double cy, const Pose& X_WC) {
  Eigen::Matrix3d direction_C;         // of a pixel: v grows down, y up, and the camera looks along -z
  direction_C << 1 / fx, 0, -cx / fx,  //
      0, -1 / fy, cy / fy,             //
      0, 0, -1;
  const Eigen::Matrix3d direction_W = X_WC.q.toRotationMatrix() * direction_C;
  Viewpoint viewpoint{};
  for (int row = 0; row < 3; ++row) {
    viewpoint[static_cast<std::size_t>(row)] = static_cast<float>(X_WC.p[row]);
    for (int column = 0; column < 3; ++column)
      viewpoint[static_cast<std::size_t>(3 + 3 * row + column)] = static_cast<float>(direction_W(row, column));
  }
  return viewpoint;
}

Viewpoint ViewpointOf(const Camera& camera) {
  return ViewpointOf(camera.focal(), camera.focal(), 0.5 * camera.width, 0.5 * camera.height, camera.X_WC);
}

}  // namespace etude
