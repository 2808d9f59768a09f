// SPDX-License-Identifier: Apache-2.0
#include "worker/task/primitives/side_hand.h"

#include <algorithm>

namespace etude::task::side {
namespace {

// Fingertips beyond the object's axis when it is grasped: pads centred on it, but never beyond its far
// side, so that it can be laid down without the tips touching the table.
double TipsBeyondAxis(const StageContext& now) {
  const double half_depth = now.shapes->object(now.target).half_extent.y();
  return std::clamp(half_depth - kSide.far_side, kSide.pad_least, kSide.pad_half_length);
}

}  // namespace

double GraspY(const StageContext& now) {
  // The fingers swing forward as they close: what counts is where the tips end up.
  return now.X_WO.p.y() + TipsBeyondAxis(now) - now.shapes->ahead_closed();
}

double GraspHeight(const StageContext& now) { return std::max(now.X_WO.p.z() + kSide.grasp_above, kSide.lowest_hand); }

Eigen::Quaterniond PushHand() {
  return Eigen::Quaterniond(Eigen::AngleAxisd(-kSide.push_tilt, Eigen::Vector3d::UnitX())) * LevelHand();
}

bool IsTurned(const StageContext& now) {
  return AngleBetween(now.X_WE.q, TurnedHand()) < AngleBetween(now.X_WE.q, LevelHand());
}

}  // namespace etude::task::side
