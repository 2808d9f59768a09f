// SPDX-License-Identifier: Apache-2.0
// Pushes off the path, so that demonstrations show how to come back to it.
#pragma once

#include "services/core/rng.h"
#include "services/spec/campaign_spec.h"
#include "worker/collide/checker.h"
#include "worker/plan/planner.h"

namespace etude::task {

/// A push: the hand slows down along its path while it is moved off by `offset` (m, world) and turned by
/// `rotation` (rotation vector, rad, world).
struct Push {
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();
  int steps = 0;
};

/// Offset of a length of up to `randomization.disturbance` in any direction; 20 to 30 steps.
Push DrawPush(const RandomizationSpec& randomization, Rng& rng);

/// The motion of a push that begins at step `from` of `motion`: starts with the path's velocity, ends at
/// rest. @pre 0 <= from < motion.steps()
plan::Motion PushMotion(const plan::Motion& motion, int from, const Push& push);

enum class PushVerdict { kFree, kTooFast, kBlocked };
/// Whether the arm can follow the push without touching anything, no joint faster than `joint_speed` (nv, rad/s).
/// `q` is near its start.
PushVerdict JudgePush(const plan::Motion& motion, const Eigen::VectorXd& q, const Eigen::VectorXd& joint_speed,
                      sim::Kinematics& kinematics, collide::Checker& checker);

}  // namespace etude::task
