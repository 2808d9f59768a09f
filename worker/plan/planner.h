// SPDX-License-Identifier: Apache-2.0
// Motions of the tool: a straight, time-parameterised path where it is free, RRT-Connect otherwise.
// Only worker/plan includes ompl/*.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "services/episode/action.h"
#include "worker/collide/checker.h"

namespace etude::plan {

enum class OutcomeKind {
  kStraight,         ///< planned: straight line of the tool
  kSampled,          ///< planned: RRT-Connect, shortcut, smoothed
  kGoalUnreachable,  ///< no inverse kinematics at the goal
  kGoalInCollision,
  kStartInCollision,
  kNoPath,     ///< the sampling budget is used up
  kNotSmooth,  ///< a path, but no time parameterisation within limits (a singularity)
};
std::string_view ToString(OutcomeKind kind);  ///< "straight", "no_path", ...

struct Limits {
  double linear = 0.30;        ///< m/s of the tool
  double angular = 1.2;        ///< rad/s
  double linear_accel = 1.5;   ///< m/s^2
  double angular_accel = 6.0;  ///< rad/s^2
  double joint = 2.5;          ///< rad/s, any joint
};

/// Tool poses at the control rate (8 ms), from the start to rest at the goal. Sample k is for the
/// time k * 8 ms: sample 0 is the start itself, the last is exactly the goal with zero velocity.
struct Motion {
  std::vector<Pose> X_WE;
  std::vector<Eigen::Matrix<double, 6, 1>> V_WE;  ///< feed-forward: linear m/s, angular rad/s
  int steps() const { return static_cast<int>(X_WE.size()); }
};

struct Outcome {
  OutcomeKind kind = OutcomeKind::kNoPath;
  std::string reason;        ///< e.g. "forearm touches bottle at 62 % of the straight path"
  Motion motion;             ///< empty unless planned
  int samples = 0;           ///< states RRT-Connect drew, 0 when it was not needed
  std::uint64_t checks = 0;  ///< collision checks spent
  bool planned() const { return kind == OutcomeKind::kStraight || kind == OutcomeKind::kSampled; }
};

struct Request {
  Eigen::VectorXd q_start;  ///< (nq)
  Pose X_WE_goal;
  Limits limits;
  /// m kept from everything. Halved until the start itself keeps it (after a release, in a grasp),
  /// down to 0.
  double margin = 0.002;
  bool straight_only = false;  ///< near contact a detour is worse than a failure
  double start_speed = 0;      ///< m/s along the path, to blend with the stage before
};

struct PlannerConfig {
  /// Budget in planner iterations, not in seconds: a wall-clock limit would make episodes depend on
  /// the machine. 4000 took 0.1 s in clutter on one core.
  int max_iterations = 4000;
  double resolution = 0.02;  ///< rad between states checked while sampling; what is
                             ///< returned was checked at a quarter of it
};

/// Plans for one arm. One per thread.
///
/// The straight line of the tool where it is free and within the joints' speed (slowed down as a
/// whole where it is not), else RRT-Connect, shortcuts and a B-spline, timed along the path. A
/// sampled path stays on the start's side of the arm's singularities, so that a controller of the
/// tool can follow it.
class Planner {
 public:
  Planner(std::shared_ptr<const sim::Scene> scene, const PlannerConfig& config = {});
  Planner(Planner&&) noexcept;
  ~Planner();

  /// A pure function of (request, what was set in `checker`, seed): the same bits whatever was
  /// planned before in this process, on whichever thread.
  Outcome Plan(const Request& request, collide::Checker& checker, std::uint64_t seed);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Straight line in position, shortest rotation, one trapezoidal profile over both so that they end
/// together; at the control rate. `start_speed` as in Request: it is kept exactly, unless stopping
/// from it would take more than twice the acceleration limit, or it turns faster than the angular
/// limit.
Motion StraightMotion(const Pose& X_WE_start, const Pose& X_WE_goal, const Limits& limits, double start_speed = 0);

}  // namespace etude::plan
