// SPDX-License-Identifier: Apache-2.0
// How far rotations jump along an episode.
#pragma once

#include <algorithm>
#include <cmath>

#include "services/episode/action.h"
#include "services/episode/episode.h"

namespace etude::task {

/// Largest change of the 6D rotation (Rotation6D, norm of the difference) from one control step to the next, commanded
/// and achieved: what a network has to learn must not jump.
inline double LargestTurn(const Episode& episode) {
  const auto distance = [](const Rotation6D& a, const Rotation6D& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
    return std::sqrt(sum);
  };
  double most = 0;
  Rotation6D command_before{}, hand_before{};
  for (int t = 0; t < episode.steps(); ++t) {
    const auto row = episode.actions_abs.row(t), q = episode.eef_quat.row(t);
    Rotation6D command;
    std::copy_n(row.begin() + 3, command.size(), command.begin());
    const Rotation6D hand = ToRotation6D(Eigen::Quaterniond(q[0], q[1], q[2], q[3]));
    if (t > 0) most = std::max({most, distance(command, command_before), distance(hand, hand_before)});
    command_before = command;
    hand_before = hand;
  }
  return most;
}

}  // namespace etude::task
