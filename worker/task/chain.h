// SPDX-License-Identifier: Apache-2.0
// Plans stages into motions, with detours where the straight line is blocked, and joins motions that run
// into each other without stopping.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "worker/plan/planner.h"
#include "worker/task/stage.h"

namespace etude::task {

/// Motion `b` begins during the last `overlap` steps of `a`: displacements and velocities add up there, so
/// that a's slowing down and b's speeding up become one smooth corner.
plan::Motion Join(const plan::Motion& a, const plan::Motion& b, int overlap);

/// A planned stage: its motion, where the arm ends, and what it took.
struct PlannedStage {
  plan::Outcome outcome;
  Eigen::VectorXd q_end;
  bool detour = false;  ///< straight pieces around the others
  std::string blocked;  ///< why the straight line would not do; empty when it did
  bool planned() const { return outcome.planned(); }
};

/// Plans for one arm. One per thread; a pure function of its arguments and the checker's state.
class StagePlanner {
 public:
  StagePlanner(std::shared_ptr<const sim::Scene> scene, collide::Checker* checker);

  /// From the hand at X_WE (arm near q_start) to `goal`: straight; else straight pieces that keep behind
  /// the objects; else sampled.
  PlannedStage Plan(const Eigen::VectorXd& q_start, const Pose& goal, const Stage& stage,
                    const std::vector<Eigen::Vector3d>& obstacles, std::uint64_t seed);
  /// Joins b to a if the corner is free, else puts it behind. Returns the number of overlapped steps.
  int JoinIfFree(plan::Motion& a, const plan::Motion& b, const plan::Limits& limits, const Eigen::VectorXd& q_corner);
  /// The arm at X_WE, near `q_seed`.
  std::optional<Eigen::VectorXd> Solve(const Pose& X_WE, const Eigen::VectorXd& q_seed) {
    return kinematics_.Solve(X_WE, q_seed);
  }
  sim::Kinematics& kinematics() { return kinematics_; }

 private:
  std::optional<PlannedStage> Detour(const Eigen::VectorXd& q_start, const Pose& goal, const Stage& stage,
                                     const std::vector<Eigen::Vector3d>& obstacles, std::uint64_t seed);
  /// `why` gets the reason when it returns nothing.
  std::optional<PlannedStage> ThroughPoints(const Eigen::VectorXd& q_start, const std::vector<Pose>& points,
                                            const Stage& stage, std::uint64_t seed, std::string& why);
  /// Follows the motion with inverse kinematics; nothing when it is lost on the way.
  std::optional<Eigen::VectorXd> EndOf(const plan::Motion& motion, const Eigen::VectorXd& q_start);

  sim::Kinematics kinematics_;
  collide::Checker* checker_;
  plan::Planner planner_;
};

}  // namespace etude::task
