// SPDX-License-Identifier: Apache-2.0
#include "worker/task/primitives/above_hand.h"
#include "worker/task/primitives/side_hand.h"

namespace etude::task {
namespace {

Pose AroundObject(const StageContext& now) {
  return {{now.X_WO.p.x(), side::GraspY(now), side::GraspHeight(now)}, LevelHand()};
}

}  // namespace

Stage MakeStage(const ReachSpec& spec, const Manner& manner) {
  Goal goal = AroundObject;
  if (manner.above()) goal = [=](const StageContext& now) { return above::AtGrasp(now, above::GripFor(now, manner)); };
  return {.name = std::string(spec.kName),
          .goal = std::move(goal),
          .limits = manner.Speed(0.35, 2.0, 1.5, 8.0),
          .straight_only = true,
          .touches_target = true,
          .disturbable = true,
          .calm = 0.06,
          .back_to = 1};
}

}  // namespace etude::task
