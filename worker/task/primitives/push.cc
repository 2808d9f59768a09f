// SPDX-License-Identifier: Apache-2.0
#include "worker/task/primitives/above_hand.h"
#include "worker/task/primitives/side_hand.h"

namespace etude::task {
namespace {

Pose BeyondObject(const StageContext& now, double further) {
  const double half_depth = now.shapes->object(now.target).half_extent.y();
  const double touch = now.X_WO.p.y() - half_depth - now.shapes->ahead_closed();
  return {{now.X_WO.p.x(), touch + further, kSide.push_height}, side::PushHand()};
}

Goal Pushed(double further, const Manner& manner) {
  if (manner.above()) return [=](const StageContext& now) { return above::Pushing(now, further); };
  return [=](const StageContext& now) { return BeyondObject(now, further); };
}

}  // namespace

Stage MakeStage(const PushSpec& spec, const Manner& manner) {
  return {.name = std::string(spec.kName),
          .goal = Pushed(spec.distance, manner),
          .nearer = Pushed(spec.least, manner),
          .closed = true,
          .limits = manner.Speed(0.12, 0.5, 1.5, 8.0),
          .straight_only = true,
          .touches_target = true,
          .held_back = kStages.held_back,
          .disturbable = true,
          .calm = 0.15,
          .back_to = 1};
}

}  // namespace etude::task
