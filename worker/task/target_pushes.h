// SPDX-License-Identifier: Apache-2.0
// Pushes of the target while a policy drives: whether it sees that things have changed.
#pragma once

#include <optional>
#include <vector>

#include "services/core/rng.h"
#include "services/spec/suite_spec.h"
#include "worker/collide/checker.h"
#include "worker/task/episode_runner.h"
#include "worker/task/scene_sampling.h"

namespace etude::task {

/// Control steps that a push takes: 0.2 s.
inline constexpr int kTargetPushSteps = 25;
/// m that must be free between the robot and the way of a push when it begins.
inline constexpr double kTargetPushClearance = 0.05;

/// Of one rollout. A push that is due begins as soon as there is a free way: a drawn direction and length to a place
/// in a location box, as far from the other objects as a start is, clear of the robot. Those that find none before
/// `latest`, or before the robot has touched the target, are missed. A push that the robot's touch meets ends there.
/// Not thread-safe.
class TargetPushes {
 public:
  /// `runner` and `checker` are borrowed. All draws come from `seed`.
  TargetPushes(const TargetPushSpec& spec, std::uint64_t seed, EpisodeRunner* runner, collide::Checker* checker);

  /// Before every control step: begins a push that is due, or goes on with the one under way.
  void BeforeStep();
  /// [{"step", "steps", "from": [x, y], "to": [x, y]}]: when it began and how long it took; m, world, as it came out.
  OrderedJson Report() const;
  /// Pushes that were wanted and not made.
  int missed() const;

 private:
  struct Push {
    int step = 0, steps = 0;
    Pose from;
    Eigen::Vector3d by = Eigen::Vector3d::Zero();   // m
    Eigen::Vector3d end = Eigen::Vector3d::Zero();  // m, world: where it came to
  };

  bool Begin();
  void GoOn();
  std::optional<Eigen::Vector3d> DrawWay(const Pose& X_WO);
  bool MayStandAt(const Eigen::Vector3d& p) const;
  bool ClearOfRobot(const Pose& X_WO, const Eigen::Vector3d& by);

  TargetPushSpec spec_;
  EpisodeRunner* runner_;
  collide::Checker* checker_;
  Rng rng_;
  std::vector<int> due_;  // control steps, ascending
  std::size_t next_ = 0;
  std::vector<Push> pushes_;
  bool under_way_ = false;
};

}  // namespace etude::task
