// SPDX-License-Identifier: Apache-2.0
// Names and shapes of the labels that a module may be trained on. S sentences an image.
//   target_class     (B, S)        int64, index into PolicyConfig::objects
//   target_pixel     (B, S, 2)     px in the camera's picture, exact perspective projection
//   target_position  (B, S, 3)     m, world, at the image's control step
//   target_pose      (B, S, 9)     position then sin/cos of roll, pitch, yaw
//   ee_pixel         (B, 1, 2)     px
//   ee_position      (B, 1, 3)     m
//   ee_pose          (B, 1, 9)
//   displacement     (B, S, 3)     m, target_position - ee_position
//   trajectory       (B, 1, 12, 10) absolute waypoints (services/episode/action.h), of the demonstrated
//                                  command (s = 0) only; "trajectory.valid" (B, 1, 12) bool masks waypoints
//                                  that lie behind a disturbance
#pragma once

#include <array>
#include <string_view>

namespace etude::data {

inline constexpr std::array<std::string_view, 9> kLabelNames{"target_class", "target_pixel", "target_position",
                                                             "target_pose",  "ee_pixel",     "ee_position",
                                                             "ee_pose",      "displacement", "trajectory"};

}  // namespace etude::data
