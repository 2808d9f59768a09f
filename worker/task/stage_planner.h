// SPDX-License-Identifier: Apache-2.0
// Plans stages into motions, with detours where the straight line is blocked, and joins motions that run
// into each other without stopping.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "worker/plan/planner.h"
#include "worker/task/primitives/stage.h"

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
  /// line | detour | rrt | field | field_escaped; @pre planned()
  std::string_view way() const;
};

/// What a stage has to get past.
struct Surroundings {
  std::vector<Eigen::Vector3d> hands;  ///< where E would be with the open hand at each other object, m
  double over = 0;                     ///< height of E above which nothing is in the way, m
  std::vector<std::string> avoid;      ///< objects to keep Stage::clearance from
};

/// Plans for one arm. One per thread; a pure function of its arguments and the checker's state.
class StagePlanner {
 public:
  StagePlanner(std::shared_ptr<const sim::Scene> scene, collide::Checker* checker);

  /// From the hand at X_WE (arm near q_start) to `goal`: straight; else straight pieces that keep behind or above
  /// the objects; else sampled. With a clearance: down the potential field.
  PlannedStage Plan(const Eigen::VectorXd& q_start, const Pose& goal, const Stage& stage, const Surroundings& around,
                    std::uint64_t seed);
  /// Where the rest of `motion` touches something by now, nothing when it is free.
  std::optional<plan::Blockage> FindBlockage(const plan::Motion& motion, int from_step, const Eigen::VectorXd& q) {
    return planner_.FindBlockage(motion, from_step, q, *checker_);
  }
  /// Brakes and goes on to `goal` another way. @param step  of `current`, due now
  plan::Outcome Replan(const plan::Motion& current, int step, const Eigen::VectorXd& q, const Pose& goal,
                       const Stage& stage, const Surroundings& around, std::uint64_t seed) {
    return planner_.Replan(current, step, q, RequestOf(q, goal, stage, around), *checker_, seed);
  }
  /// Joins b to a if the corner is free, else puts it behind. Returns the number of overlapped steps.
  int JoinIfFree(plan::Motion& a, const plan::Motion& b, const plan::Limits& limits, const Eigen::VectorXd& q_corner);
  /// The arm at X_WE, near `q_seed`.
  std::optional<Eigen::VectorXd> Solve(const Pose& X_WE, const Eigen::VectorXd& q_seed) {
    return kinematics_.Solve(X_WE, q_seed);
  }
  sim::Kinematics& kinematics() { return kinematics_; }

 private:
  static plan::Request RequestOf(const Eigen::VectorXd& q_start, const Pose& goal, const Stage& stage,
                                 const Surroundings& around);
  /// The straight line or nothing: then `outcome` says why.
  PlannedStage Line(const Eigen::VectorXd& q_start, const Pose& goal, const Stage& stage, std::uint64_t seed);
  /// `planned` with its q_end, or why it cannot be followed.
  PlannedStage Followed(PlannedStage planned, const Eigen::VectorXd& q_start);
  std::optional<PlannedStage> Detour(const Eigen::VectorXd& q_start, const Pose& goal, const Stage& stage,
                                     const Surroundings& around, std::uint64_t seed);
  std::optional<PlannedStage> ThroughPoints(const Eigen::VectorXd& q_start, const std::vector<Pose>& points,
                                            const Stage& stage, std::uint64_t seed);
  bool CornerIsFree(const plan::Motion& motion, int first, int steps, double joint_speed,
                    const Eigen::VectorXd& q_corner);
  /// Follows the motion with inverse kinematics; nothing when it is lost on the way.
  std::optional<Eigen::VectorXd> EndOf(const plan::Motion& motion, const Eigen::VectorXd& q_start);

  sim::Kinematics kinematics_;
  collide::Checker* checker_;
  plan::Planner planner_;
};

}  // namespace etude::task
