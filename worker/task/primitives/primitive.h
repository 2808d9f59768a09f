// SPDX-License-Identifier: Apache-2.0
// A primitive makes one stage of a task: its motion's goal for level hands and for hands from above, its speed, what it
// touches. One file a primitive, named after it; services/spec/task_spec.h has their parameters. Internal to
// worker/task.
#pragma once

#include "services/spec/task_spec.h"
#include "worker/task/primitives/stage.h"

namespace etude::task {

/// How the hand comes at things in a task.
struct Manner {
  double pitch = 0;         ///< rad below the horizontal; 0: level, from the side
  bool lengthwise = false;  ///< sets down beside a reference along x: a hand wider than thick goes lengthwise between
  double joint_speed = 0;   ///< rad/s, of the slowest joint

  bool above() const { return pitch > 0; }
  plan::Limits Speed(double linear, double linear_accel, double angular, double angular_accel) const {
    return {.linear = linear,
            .angular = angular,
            .linear_accel = linear_accel,
            .angular_accel = angular_accel,
            .joint = joint_speed};
  }
};

Stage MakeStage(const ApproachSpec& spec, const Manner& manner);
Stage MakeStage(const ReachSpec& spec, const Manner& manner);
Stage MakeStage(const GraspSpec& spec, const Manner& manner);
Stage MakeStage(const LiftSpec& spec, const Manner& manner);
Stage MakeStage(const TurnSpec& spec, const Manner& manner);
Stage MakeStage(const CarrySpec& spec, const Manner& manner);
Stage MakeStage(const PushSpec& spec, const Manner& manner);
Stage MakeStage(const PlaceSpec& spec, const Manner& manner);
Stage MakeStage(const ReleaseSpec& spec, const Manner& manner);
Stage MakeStage(const RetreatSpec& spec, const Manner& manner);
Stage MakeStage(const HoldSpec& spec, const Manner& manner);

}  // namespace etude::task
