// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>

#include "services/core/check.h"
#include "worker/task/goals.h"

namespace etude::task {
namespace {

// Fingertips behind the object's axis before it reaches. Further back, the wrist of an arm that reaches for
// a near object comes too close to the shoulder's axis.
constexpr double kBehind = 0.085;         // m
constexpr double kNearest = 0.065;        // m, the least of it when the hand is already on the line
constexpr double kOnLine = 0.04;          // m off the line at most to count as on it
constexpr double kGraspAbove = 0.01;      // m above the body's origin
constexpr double kLowestHand = 0.058;     // m of the level hand: its wrist needs 0.05
constexpr double kPadHalfLength = 0.018;  // m, fingertips pass the object's axis by this
constexpr double kLiftHeight = 0.15;      // m of the tool
constexpr double kTurnBack = 0.15;        // m towards the robot while turning
constexpr double kTurnedReach = 0.56;     // m from the base's axis that the hand can point down
// Objects are pushed low so that they slide instead of tipping over: the tips just above the table, the
// hand tilted so that its wrist stays clear.
constexpr double kPushHeight = 0.019;  // m of the tool
constexpr double kPushTilt = 0.25;     // rad
constexpr double kPushFurther = 0.11;  // m that the object is pushed
constexpr double kPushLess = 0.06;     // m where a neighbour is in the way of the forearm further on
constexpr double kPlaceGap = 0.002;    // m between object and table when it is released
constexpr double kFingerGap = 0.005;   // m between fingertips and table

// Fingertips beyond the object's axis when it is grasped: pads centred on it, but never beyond its far
// side, so that it can be laid down without the tips touching the table.
double TipsBeyondAxis(const Situation& now) {
  const double half_depth = now.shapes->object(now.target).half_extent.y();
  return std::clamp(half_depth - 0.006, 0.010, kPadHalfLength);
}

double GraspY(const Situation& now) {
  // The fingers swing forward as they close: what counts is where the tips end up.
  return now.X_WO.p.y() + TipsBeyondAxis(now) - now.shapes->ahead_closed();
}

double GraspHeight(const Situation& now) { return std::max(now.X_WO.p.z() + kGraspAbove, kLowestHand); }

Eigen::Quaterniond PushHand() {
  return Eigen::Quaterniond(Eigen::AngleAxisd(-kPushTilt, Eigen::Vector3d::UnitX())) * LevelHand();
}

// Behind the object at `height`, in line with it.
Pose Behind(const Situation& now, double height, const Eigen::Quaterniond& q_WE) {
  const Eigen::Vector3d& p = now.X_WO.p;
  const double aside = std::hypot(now.X_WE.p.x() - p.x(), now.X_WE.p.z() - height);
  const double far = p.y() - kBehind, near = p.y() - kNearest;
  // A hand that is on the line already goes on from where it is instead of backing off.
  const double y = aside < kOnLine ? std::clamp(now.X_WE.p.y() + 0.01, far, near) : far;
  return {{p.x(), y - now.shapes->ahead_open(), height}, q_WE};
}

Pose BehindToGrasp(const Situation& now) { return Behind(now, GraspHeight(now), LevelHand()); }
Pose BehindToPush(const Situation& now) { return Behind(now, kPushHeight, PushHand()); }

Pose AroundObject(const Situation& now) { return {{now.X_WO.p.x(), GraspY(now), GraspHeight(now)}, LevelHand()}; }

Pose BeyondObject(const Situation& now, double further) {
  const double half_depth = now.shapes->object(now.target).half_extent.y();
  const double touch = now.X_WO.p.y() - half_depth - now.shapes->ahead_closed();
  return {{now.X_WO.p.x(), touch + further, kPushHeight}, PushHand()};
}

Pose PushedFar(const Situation& now) { return BeyondObject(now, kPushFurther); }
Pose PushedLess(const Situation& now) { return BeyondObject(now, kPushLess); }

Pose Lifted(const Situation& now) { return {{now.X_WE.p.x(), now.X_WE.p.y(), kLiftHeight}, LevelHand()}; }

Pose Turned(const Situation& now) {
  // A hand that is part of the way round has moved back by that part already.
  const double left = AngleBetween(now.X_WE.q, TurnedHand()) / (std::numbers::pi / 2);
  const double x = now.X_WE.p.x() - now.shapes->base().x();
  const double back = now.X_WE.p.y() - kTurnBack * std::clamp(left, 0.0, 1.0);
  const double within = std::sqrt(std::max(0.0, kTurnedReach * kTurnedReach - x * x)) + now.shapes->base().y();
  return {{now.X_WE.p.x(), std::min(back, within), kLiftHeight}, TurnedHand()};
}

Pose OnTable(const Situation& now) {
  ETUDE_CHECK(now.X_EO.has_value());
  const Pose X_WO = Pose{Eigen::Vector3d::Zero(), TurnedHand()} * *now.X_EO;  // for a hand at the origin
  const double object = now.shapes->HeightOnTable(now.target, X_WO.q) - X_WO.p.z() + kPlaceGap;
  const double tips = std::max(now.shapes->ahead_open(), now.shapes->ahead_closed()) + kFingerGap;
  return {{now.X_WE.p.x(), now.X_WE.p.y(), std::max(object, tips)}, TurnedHand()};
}

Pose Above(const Situation& now) { return {{now.X_WE.p.x(), now.X_WE.p.y(), kLiftHeight}, TurnedHand()}; }

}  // namespace

TaskGoals SideGoals() {
  return {.before_grasp = BehindToGrasp,
          .at_grasp = AroundObject,
          .lifted = Lifted,
          .before_push = BehindToPush,
          .pushed = PushedFar,
          .pushed_less = PushedLess,
          .turned = Turned,
          .laid = OnTable,
          .retreated = Above};
}

}  // namespace etude::task
