// SPDX-License-Identifier: Apache-2.0
#include "worker/task/standstill.h"

#include <algorithm>
#include <cmath>

namespace etude::task {
namespace {

// More than twice what a grasp is waited for (FingerWait).
constexpr int kLong = 240;        // control steps
constexpr double kNear = 0.03;    // m
constexpr double kTurned = 0.3;   // rad
constexpr double kFingers = 0.5;  // of their whole way

}  // namespace

bool Standstill::At(int step, const Pose& X_WE, double gripper) {
  const auto is_here = [&](const Place& place) {
    return (place.X_WE.p - X_WE.p).norm() < kNear && AngleBetween(place.X_WE.q, X_WE.q) < kTurned &&
           std::abs(place.gripper - gripper) < kFingers;
  };
  places_.push_back({step, X_WE, gripper});
  // what was before the last place from which the hand has gone away does not count
  const auto away = std::find_if_not(places_.rbegin(), places_.rend(), is_here);
  places_.erase(places_.begin(), away.base());
  if (step - places_.front().step < kLong) return false;
  places_.clear();
  return true;
}

}  // namespace etude::task
