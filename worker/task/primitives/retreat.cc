// SPDX-License-Identifier: Apache-2.0
#include "worker/task/primitives/above_hand.h"
#include "worker/task/primitives/side_hand.h"

namespace etude::task {
namespace {

Pose UpFromTheSide(const StageContext& now) {
  return {{now.X_WE.p.x(), now.X_WE.p.y(), kSide.lift_height}, side::NearestHand(now)};
}

}  // namespace

Stage MakeStage(const RetreatSpec& spec, const Manner& manner) {
  Goal goal = UpFromTheSide;
  if (manner.above())
    goal = [=](const StageContext& now) {
      const Eigen::Vector3d away =
          spec.back() ? Eigen::Vector3d(-above::GripFor(now, manner).approach()) : Eigen::Vector3d::UnitZ();
      return Pose{now.X_WE.p + spec.distance * away, now.X_WE.q};
    };
  return {.name = std::string(spec.kName),
          .goal = std::move(goal),
          .limits = manner.Speed(0.45, 2.5, 1.5, 8.0),
          .straight_only = true,
          .touches_target = true};
}

}  // namespace etude::task
