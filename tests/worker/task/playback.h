// SPDX-License-Identifier: Apache-2.0
// A scripted policy that knows the expert's commands.
#pragma once

#include <algorithm>

#include "services/episode/episode.h"
#include "services/policy/policy_types.h"

namespace etude::task {

// Answers the commands of a demonstration of the same scene, from where the clock stands.
class Playback {
 public:
  Playback(const Episode& episode, int replan_steps) : episode_(episode), replan_(replan_steps) {}

  policy::Answer operator()(const policy::Question&) {
    policy::Answer answer;
    for (int k = 0; k < kWaypoints; ++k) {
      const int t = std::min<int>(asked_ * replan_ + static_cast<int>(WaypointStep(k)), episode_.steps() - 1);
      answer.waypoints.push_back(FromVector(episode_.actions_abs.row(t).data()));
    }
    const int now = std::min(asked_ * replan_, episode_.steps() - 1);
    const auto hand = episode_.eef_pos.row(now);
    answer.modules["EE3D"] = {{"entity", "ee"}, {"quantity", "pose"}, {"value", {hand[0], hand[1], hand[2], 1, 0, 0}}};
    const auto object = episode_.FindObject(episode_.target)->pose.row(0);
    answer.modules["TAR3D"] = {
        {"entity", "target"}, {"quantity", "position"}, {"value", {object[0], object[1], object[2] + 0.02}}};
    answer.modules["REF3D"] = {{"entity", "nobody"}, {"quantity", "position"}, {"value", {0, 0, 0}}};
    answer.modules["LANG"] = {{"entity", "target"}, {"quantity", "class"}, {"value", "coke"}};
    answer.checkpoint_step = 7;
    ++asked_;
    return answer;
  }

 private:
  const Episode& episode_;
  int replan_;
  int asked_ = 0;
};

}  // namespace etude::task
