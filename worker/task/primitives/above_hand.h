// SPDX-License-Identifier: Apache-2.0
// What several primitives share about a hand that comes from above, pitched down. Internal to worker/task.
#pragma once

#include "worker/task/primitives/primitive.h"
#include "worker/task/primitives/tuning.h"

namespace etude::task::above {

/// How the hand comes at things and carries them.
struct Grip {
  double pitch = 0;  ///< rad, see Hand()
  double yaw = 0;    ///< rad about the vertical: 0 closes along x, pi/2 along y

  Eigen::Quaterniond q() const {
    return Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ())) * Hand(pitch);
  }
  Eigen::Vector3d approach() const { return Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * ApproachOf(pitch); }
};

Grip GripFor(const StageContext& now, const Manner& manner);
/// z of the top of the target, of the reference, m.
double TopOfTarget(const StageContext& now);
double TopOfReference(const StageContext& now);
/// How far a part reaches below E, m.
double Below(const StageContext& now, SceneGeometry::Part part, bool closed, const Eigen::Quaterniond& q_WE);
/// Lowest z of E at which the hand is off the table, whatever its fingers do.
double LowestHand(const StageContext& now, const Eigen::Quaterniond& q_WE);
/// The fingertips at the object's axis, as deep as object, palm and table allow.
Pose AtGrasp(const StageContext& now, const Grip& grip);
/// The closed fingertips behind the target, `further` (m) than where they touch it.
Pose Pushing(const StageContext& now, double further);
/// The hand where it sets down what it holds, seen from the reference; z is 0.
Pose AtPlace(const StageContext& now, const Grip& grip, Whereto to);
/// z of E down to which the target goes there, m.
double PlaceHeight(const StageContext& now, const Eigen::Quaterniond& q_WE, Whereto to, double gap);

}  // namespace etude::task::above
