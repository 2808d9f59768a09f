// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>

#include "worker/task/primitives/above_hand.h"

namespace etude::task {
namespace {

Pose TurnedFromTheSide(const StageContext& now) {
  // A hand that is part of the way round has moved back by that part already.
  const double left = AngleBetween(now.X_WE.q, TurnedHand()) / (std::numbers::pi / 2);
  const double x = now.X_WE.p.x() - now.shapes->base().x();
  const double back = now.X_WE.p.y() - kSide.turn_back * std::clamp(left, 0.0, 1.0);
  const double within =
      std::sqrt(std::max(0.0, kSide.turned_reach * kSide.turned_reach - x * x)) + now.shapes->base().y();
  const double below = now.X_EO ? std::max(HeldBelow(now, TurnedHand()), HeldBelow(now, now.X_WE.q)) : 0;
  const double z = std::max(kSide.lift_height, below + kSide.lift_room);
  return {{now.X_WE.p.x(), std::min(back, within), z}, TurnedHand()};
}

// A quarter of a turn: where the hand comes to point back at the robot it moves towards it by what is left to turn, and
// where it comes to point away it needs room for the wrist behind it.
Pose TurnedFromAbove(const StageContext& now, double lean) {
  const bool back = now.shapes->turned_pitch() > std::numbers::pi / 2;
  const double pitch = now.shapes->turned_pitch() + (back ? -lean : lean);
  const Eigen::Vector2d from_base = now.X_WE.p.head<2>() - now.shapes->base();
  double y = now.X_WE.p.y();
  if (back) {
    const double left = AngleBetween(now.X_WE.q, Hand(pitch)) / (std::numbers::pi / 2);
    y -= kAbove.turn_back * std::clamp(left, 0.0, 1.0);
  } else {
    const double x = from_base.x();
    const double reach = kAbove.turned_reach;
    y = std::max(y, now.shapes->base().y() + std::sqrt(std::max(0.0, reach * reach - x * x)));
  }
  const double below = std::max(HeldBelow(now, Hand(pitch)), HeldBelow(now, now.X_WE.q));
  return {{now.X_WE.p.x(), y, std::max(now.X_WE.p.z(), below + kAbove.turned_below)}, Hand(pitch)};
}

}  // namespace

Stage MakeStage(const TurnSpec& spec, const Manner& manner) {
  Goal goal = TurnedFromTheSide;
  if (manner.above()) goal = [=](const StageContext& now) { return TurnedFromAbove(now, spec.lean); };
  return HeldStage(spec.kName, std::move(goal), manner.Speed(0.45, 2.0, 2.4, 10.0));
}

}  // namespace etude::task
