// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "services/core/check.h"
#include "worker/task/primitives/above_hand.h"
#include "worker/task/primitives/side_hand.h"

namespace etude::task {
namespace {

// Down until the object or the hand is just above the table.
Pose LaidFromTheSide(const StageContext& now, double gap) {
  ETUDE_CHECK(now.X_EO.has_value());
  const Eigen::Quaterniond q = side::NearestHand(now);
  const Pose X_WO = Pose{Eigen::Vector3d::Zero(), q} * *now.X_EO;  // for a hand at the origin
  const double object = now.shapes->HeightOnTable(now.target, X_WO.q) - X_WO.p.z() + gap;
  const double tips = std::max(now.shapes->ahead_open(), now.shapes->ahead_closed()) + kSide.finger_gap;
  return {{now.X_WE.p.x(), now.X_WE.p.y(), std::max(object, side::IsTurned(now) ? tips : kSide.lowest_hand)}, q};
}

Goal GoalOf(const PlaceSpec& spec, const Manner& manner) {
  const Whereto to = spec.whereto();
  const double gap = spec.gap;
  if (!manner.above()) return [=](const StageContext& now) { return LaidFromTheSide(now, gap); };
  if (to == Whereto::kHere)
    return [=](const StageContext& now) {
      return Pose{{now.X_WE.p.x(), now.X_WE.p.y(), above::PlaceHeight(now, now.X_WE.q, to, gap)}, now.X_WE.q};
    };
  return [=](const StageContext& now) {
    Pose goal = above::AtPlace(now, above::GripFor(now, manner), to);
    goal.p.z() = above::PlaceHeight(now, goal.q, to, gap);
    return goal;
  };
}

}  // namespace

Stage MakeStage(const PlaceSpec& spec, const Manner& manner) {
  return {.name = std::string(spec.kName),
          .goal = GoalOf(spec, manner),
          .closed = true,
          .limits = manner.Speed(0.35, 1.6, 1.5, 8.0),
          .straight_only = true,
          .touches_target = true,
          .nears_reference = spec.whereto() == Whereto::kOnTop || spec.whereto() == Whereto::kInside,
          .holds = true,
          .disturbable = true,
          .calm = 0.07};
}

}  // namespace etude::task
