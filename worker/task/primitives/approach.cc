// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "worker/task/primitives/above_hand.h"
#include "worker/task/primitives/side_hand.h"

namespace etude::task {
namespace {

using Part = SceneGeometry::Part;

// Behind the object at `height`, in line with it.
// @param room  m from the object's axis at least
Pose Behind(const StageContext& now, double height, const Eigen::Quaterniond& q_WE, double room = 0) {
  const Eigen::Vector3d& p = now.X_WO.p;
  const double aside = std::hypot(now.X_WE.p.x() - p.x(), now.X_WE.p.z() - height);
  const double further = std::max(0.0, room - kSide.behind);
  const double far = p.y() - kSide.behind - further, near = p.y() - kSide.nearest - further;
  // A hand that is on the line already goes on from where it is instead of backing off.
  const double y = aside < kStages.on_line ? std::clamp(now.X_WE.p.y() + 0.01, far, near) : far;
  return {{p.x(), y - now.shapes->ahead_open(), height}, q_WE};
}

// Back along the approach until the open fingers clear the object's top.
Pose BeforeGrasp(const StageContext& now, const above::Grip& grip) {
  const Pose at = above::AtGrasp(now, grip);
  const Eigen::Vector3d a = grip.approach();
  const double clear = above::TopOfTarget(now) + kAbove.hover + above::Below(now, Part::kFingers, false, at.q);
  const double far = std::max(kAbove.least_back, (clear - at.p.z()) / std::sin(grip.pitch));
  const Eigen::Vector3d from = now.X_WE.p - at.p;
  const double back = -from.dot(a);
  const bool on_line = (from + back * a).norm() < kStages.on_line;
  const double distance = on_line ? std::clamp(back - 0.01, far - kAbove.hover_slack, far) : far;
  return {at.p - distance * a, at.q};
}

Goal GoalOf(const ApproachSpec& spec, const Manner& manner) {
  if (spec.pushes() && manner.above())
    return [](const StageContext& now) { return above::Pushing(now, -kAbove.push_behind); };
  if (spec.pushes())
    return [](const StageContext& now) {
      const double swing = now.shapes->ahead_closed() - now.shapes->ahead_open();  // fingers reach further closed
      const double room = now.shapes->object(now.target).half_extent.y() + swing + kSide.push_room;
      return Behind(now, kSide.push_height, side::PushHand(), room);
    };
  if (manner.above()) return [=](const StageContext& now) { return BeforeGrasp(now, above::GripFor(now, manner)); };
  return [](const StageContext& now) { return Behind(now, side::GraspHeight(now), LevelHand()); };
}

}  // namespace

Stage MakeStage(const ApproachSpec& spec, const Manner& manner) {
  return {.name = std::string(spec.kName),
          .goal = GoalOf(spec, manner),
          .closed = spec.pushes(),
          .limits = manner.Speed(0.70, 3.5, 2.4, 12.0),
          .blends = true,
          .disturbable = true,
          .calm = 0.03};
}

}  // namespace etude::task
