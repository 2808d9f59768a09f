// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "worker/task/primitives/above_hand.h"

namespace etude::task {
namespace {

// Above its place, over a reference that it goes on or into.
Pose Carried(const StageContext& now, const above::Grip& grip, const CarrySpec& spec) {
  const Whereto to = spec.whereto();
  Pose goal = above::AtPlace(now, grip, to);
  double room = spec.room;
  if (to == Whereto::kOnTop || to == Whereto::kInside)
    room = std::max(room, above::TopOfReference(now) + kAbove.over_reference);
  goal.p.z() = std::max(now.X_WE.p.z(), HeldBelow(now, goal.q) + room);
  return goal;
}

}  // namespace

Stage MakeStage(const CarrySpec& spec, const Manner& manner) {
  return HeldStage(
      spec.kName, [=](const StageContext& now) { return Carried(now, above::GripFor(now, manner), spec); },
      manner.Speed(0.45, 2.0, 1.5, 8.0));
}

}  // namespace etude::task
