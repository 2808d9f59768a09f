// SPDX-License-Identifier: Apache-2.0
// Motions of the tool: a straight, time-parameterised path where it is free, RRT-Connect otherwise.
// Only worker/plan includes ompl/*.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "services/episode/action.h"
#include "worker/collide/checker.h"

namespace etude::plan {

enum class OutcomeKind {
  kStraight,         ///< planned: straight line of the tool
  kSampled,          ///< planned: RRT-Connect, shortcut, smoothed
  kField,            ///< planned: down the potential field
  kFieldEscaped,     ///< planned: the field has a local minimum, left by RRT-Connect
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
  /// Between two samples; what is before the first or after the last is that one.
  Pose At(double step) const;
};

struct Outcome {
  OutcomeKind kind = OutcomeKind::kNoPath;
  std::string reason;  ///< e.g. "forearm touches bottle at 62 % of the straight path"
  Motion motion;       ///< empty unless planned
  /// The arm at the end of the tool's straight line, empty when it cannot be followed to there.
  Eigen::VectorXd q_line_end;
  int samples = 0;           ///< states RRT-Connect drew, 0 when it was not needed
  std::uint64_t checks = 0;  ///< collision checks spent
  /// Where the time went, s. Only to be looked at: no plan depends on it.
  struct Times {
    double plan = 0, simplify = 0, parameterise = 0;
  } times;
  bool planned() const {
    return kind == OutcomeKind::kStraight || kind == OutcomeKind::kSampled || kind == OutcomeKind::kField ||
           kind == OutcomeKind::kFieldEscaped;
  }
};

enum class Method {
  kStraightFirst,   ///< the tool's straight line, RRT-Connect where it is blocked
  kSampled,         ///< RRT-Connect: for those who know that the line is blocked
  kPotentialField,  ///< drawn to the goal, kept off obstacles by `clearance`; RRT-Connect out of local minima
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

  Method method = Method::kStraightFirst;
  Eigen::VectorXd q_goal;  ///< kSampled: tried first of the arm's configurations at the goal; may be empty
  /// kPotentialField: m from the obstacles that the field tries to keep for the whole arm; a path gets nearer where
  /// there is no room, and as near as start and goal themselves are. Straight lines and `straight_only` know only
  /// `margin`.
  double clearance = 0.05;
  std::vector<std::string> obstacles;  ///< objects to keep `clearance` from; empty: all
};

/// Where a motion is not free any more.
struct Blockage {
  int step = 0;        ///< of the motion
  std::string reason;  ///< e.g. "left_finger touches ball at step 120"
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
/// tool can follow it. Or down a potential field, see Method.
class Planner {
 public:
  Planner(std::shared_ptr<const sim::Scene> scene, const PlannerConfig& config = {});
  Planner(Planner&&) noexcept;
  ~Planner();

  /// A pure function of (request, what was set in `checker`, seed): the same bits whatever was
  /// planned before in this process, on whichever thread.
  Outcome Plan(const Request& request, collide::Checker& checker, std::uint64_t seed);

  /// Looks whether the rest of a motion is still free, with the obstacles where `checker` now has them. Cheap: about
  /// 1 ms for a rest of half a metre, for every tenth control step or so.
  /// @param from_step  step of the motion that is due now   @param q  the arm at that step, roughly
  /// @param margin  m to keep; a rest that starts nearer may leave
  /// @returns nothing when it is free, else the first place where it is not.
  std::optional<Blockage> FindBlockage(const Motion& motion, int from_step, const Eigen::VectorXd& q,
                                       collide::Checker& checker, double margin = 0.002);

  /// Another motion to the goal of `request` for an arm that is on its way: brakes along `current`, as `request.limits`
  /// allow, then goes on as planned from there. Sample 0 of the motion is sample `step` of `current`, at its speed;
  /// q_start and start_speed of the request are not used. Kinds as of Plan; kStartInCollision also when braking takes
  /// the arm into an obstacle.
  /// @param q  the arm at that step, roughly
  Outcome Replan(const Motion& current, int step, const Eigen::VectorXd& q, const Request& request,
                 collide::Checker& checker, std::uint64_t seed);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Straight line in position, shortest rotation, one trapezoidal profile over both so that they end
/// together; at the control rate. `start_speed` as in Request: it is kept exactly, unless stopping
/// from it would take more than twice the acceleration limit, or it turns faster than the angular
/// limit.
Motion StraightMotion(const Pose& X_WE_start, const Pose& X_WE_goal, const Limits& limits, double start_speed = 0);

/// Along `motion` from sample `step`, with its velocity there, to rest as soon as the limits allow and no later than
/// its end. Sample 0 is that of `motion`; a single sample when it is at rest already.
Motion Brake(const Motion& motion, int step, const Limits& limits);

}  // namespace etude::plan
