// SPDX-License-Identifier: Apache-2.0
// A hand that a policy leads nowhere.
#pragma once

#include <vector>

#include "services/episode/pose.h"

namespace etude::task {

/// Whether a hand has gone nowhere for a while, told by where it was at each question to the policy. A policy without
/// memory can lead it round in a small circle for ever: each answer goes on only behind the waypoint at which the next
/// one takes its place ("a little up, and then down to the grasp").
class Standstill {
 public:
  /// To be asked at every question, with growing steps.
  /// @param step    control step of the rollout
  /// @param X_WE    of the hand
  /// @param gripper how far the fingers are closed, as measured: 0 open .. 1 closed
  /// @returns whether hand and fingers have stayed where they are for 1.9 s; then it is counted anew.
  bool At(int step, const Pose& X_WE, double gripper);

 private:
  struct Place {
    int step;
    Pose X_WE;
    double gripper;
  };
  std::vector<Place> places_;  // of the time for which the hand has been here, the latest last
};

}  // namespace etude::task
