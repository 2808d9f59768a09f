// SPDX-License-Identifier: Apache-2.0
// The one list of an episode's tracks, so that codec, file and checks cannot disagree about them.
#pragma once

#include <string>

#include "services/episode/action.h"
#include "services/episode/episode.h"

namespace etude {

inline constexpr int kAnyColumns = 0;  ///< as many as the robot or the model has

/// Calls fn(name, track, columns) for each track of the low-dimensional part, in a fixed order.
/// `Track&` is const when the episode is. Objects' tracks are named "objects/NAME/pose" and
/// ".../pixel".
template <class AnyEpisode, class Function>
void VisitTracks(AnyEpisode& episode, Function&& fn) {
  fn("joint_pos", episode.joint_pos, kAnyColumns);
  fn("joint_vel", episode.joint_vel, kAnyColumns);
  fn("gripper_qpos", episode.gripper_qpos, kAnyColumns);
  fn("eef_pos", episode.eef_pos, 3);
  fn("eef_quat", episode.eef_quat, 4);
  fn("eef_pixel", episode.eef_pixel, 2);
  fn("actions_abs", episode.actions_abs, kWaypointSize);
  fn("states", episode.states, kAnyColumns);
  for (auto& object : episode.objects) {
    fn("objects/" + object.name + "/pose", object.pose, 7);
    fn("objects/" + object.name + "/pixel", object.pixel, 2);
  }
}

}  // namespace etude
