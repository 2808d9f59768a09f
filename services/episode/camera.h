// SPDX-License-Identifier: Apache-2.0
// The pinhole camera that renders an observation and projects labels exactly.
#pragma once

#include <Eigen/Core>
#include <string>

#include "services/episode/pose.h"

namespace etude {

/// Frame C as in OpenGL and MuJoCo: x right, y up, the camera looks along -z. Square pixels.
struct Camera {
  std::string name = "front";
  int width = 224;                   ///< px
  int height = 224;                  ///< px
  double fovy = 1.0471975511965976;  ///< vertical field of view, rad
  Pose X_WC;                         ///< camera in world

  /// Focal length in px: (height / 2) / tan(fovy / 2).
  double focal() const;
  /// World point (m) -> pixel (u right, v down, origin at the top-left corner of the image, so a
  /// pixel's centre is at +0.5). Points behind the camera give NaN. Not clipped to the image.
  Eigen::Vector2d Project(const Eigen::Vector3d& p_W) const;
};

}  // namespace etude
