// SPDX-License-Identifier: Apache-2.0
// A camera as a network reads it: where it is, and which way each of its pixels looks.
#pragma once

#include <array>

#include "services/episode/camera.h"

namespace etude {

/// p_WC (3, m), then row by row the 3x3 matrix that takes a pixel (u, v, 1) to the direction in world in which it
/// looks, as long as one metre along the camera's axis.
inline constexpr int kViewpointSize = 12;
using Viewpoint = std::array<float, kViewpointSize>;

/// Focal lengths fx, fy > 0 and the principal point cx, cy, px; C as in camera.h.
Viewpoint ViewpointOf(double fx, double fy, double cx, double cy, const Pose& X_WC);
Viewpoint ViewpointOf(const Camera& camera);

}  // namespace etude
