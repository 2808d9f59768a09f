// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "worker/task/primitives/above_hand.h"

namespace etude::task {
namespace {

Pose Lifted(const StageContext& now) {
  const double below = now.X_EO ? HeldBelow(now, LevelHand()) : 0;
  return {{now.X_WE.p.x(), now.X_WE.p.y(), std::max(kSide.lift_height, below + kSide.lift_room)}, LevelHand()};
}

// Straight up, until there is `room` under what is held.
Pose Raised(const StageContext& now, const above::Grip& grip, double room) {
  const Eigen::Quaterniond q = grip.q();
  const double below = now.X_EO ? HeldBelow(now, q) : above::Below(now, SceneGeometry::Part::kHand, true, q);
  return {{now.X_WE.p.x(), now.X_WE.p.y(), std::max(now.X_WE.p.z(), below + room)}, q};
}

}  // namespace

Stage MakeStage(const LiftSpec& spec, const Manner& manner) {
  Goal goal = Lifted;
  if (manner.above())
    goal = [=](const StageContext& now) { return Raised(now, above::GripFor(now, manner), spec.room); };
  Stage stage = HeldStage(spec.kName, std::move(goal), manner.Speed(0.45, 2.5, 1.5, 8.0));
  stage.blends = true;
  stage.calm = 0.05;
  return stage;
}

}  // namespace etude::task
