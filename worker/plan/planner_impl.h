// SPDX-License-Identifier: Apache-2.0
// What Planner is made of. Private to worker/plan: planner*.cc share it.
#pragma once

#include <fmt/format.h>

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "services/core/clock.h"
#include "services/core/rng.h"
#include "worker/plan/joint_curve.h"
#include "worker/plan/line_motion.h"
#include "worker/plan/planner.h"
#include "worker/plan/potential_field.h"
#include "worker/plan/sampling.h"
#include "worker/plan/timer.h"

namespace etude::plan {

namespace internal {

// a quarter of `resolution` between the states of what is returned
inline constexpr int kFiner = 4;
// of the asked speed; slower is as good as not smooth
inline constexpr double kSlowest = 0.2;

/// "forearm touches bottle"
std::string Touches(const collide::Collision& collision);
/// Signed for a square Jacobian, so that its sign tells on which side of a singularity q is.
double Manipulability(const Eigen::MatrixXd& J);
/// Always false.
bool Fail(Outcome& outcome, OutcomeKind kind, std::string reason);

}  // namespace internal

struct Planner::Impl {
  // The line in joint space: q at equal steps of the line's parameter.
  struct Track {
    std::vector<Eigen::VectorXd> q;
    bool complete = false;
    double reached = 0;  ///< parameter of the last q
  };
  struct Strain {
    double excess = 0;  ///< joint speed over its limit
    double s = 0;       ///< where on the line
    int joint = 0;
  };
  // One call of Plan.
  struct Call {
    const Request& request;
    collide::Checker& checker;
    Rng rng;
    double margin = 0;
    double room = 0;                                 ///< kept beyond the margin while sampling
    double resolution = 0;                           ///< while sampling
    double least = 0;                                ///< manipulability below this is singular; signed like the start's
    std::optional<internal::Influence> influence{};  ///< of obstacles that want more than the margin
    double keep = 0;                                 ///< part of that influence that a path must keep
    Outcome outcome{};
  };

  Impl(std::shared_ptr<const sim::Scene> scene_in, const PlannerConfig& config_in)
      : scene(std::move(scene_in)),
        config(config_in),
        kinematics(scene),
        home_manipulability(std::abs(internal::Manipulability(kinematics.Jacobian(scene->arm().q_home)))) {}

  void Plan(Call& call);
  void PlanStraightFirst(Call& call, const internal::ToolLine& line, const Track& track, const Eigen::VectorXd& q_goal);
  bool CheckStart(Call& call);
  Track Follow(const internal::ToolLine& line, const Eigen::VectorXd& q_start);
  bool LineIsFree(Call& call, const Track& track);
  static Strain WorstStrain(const internal::LineMotion& timed, const Track& track, double joint_limit);
  /// Where following `motion` asks most of a redundant arm's joint; s is a share of its time.
  Strain TrackedStrain(const Motion& motion, const Eigen::VectorXd& q_start, double joint_limit);
  bool TimeLine(Call& call, const internal::ToolLine& line, const Track& track);
  std::optional<Eigen::VectorXd> FindGoal(Call& call, const Track& track);
  double FindRoom(Call& call, const Eigen::VectorXd& q_goal);
  internal::SamplingProblem MakeProblem(Call& call, const Eigen::VectorXd& q_goal);
  void Detour(Call& call, const Eigen::VectorXd& q_goal);
  void PlanSampled(Call& call);
  /// Detour, unless the goal lies beyond a singularity.
  void GoRound(Call& call, const Eigen::VectorXd& q_goal);
  std::optional<Motion> TimeCurve(Call& call, const internal::JointCurve& curve);
  bool Smooth(Call& call, const std::vector<Eigen::VectorXd>& path, OutcomeKind kind);
  std::vector<Eigen::VectorXd> Shorten(Call& call, const std::vector<Eigen::VectorXd>& path);
  bool CurveIsFree(Call& call, const internal::JointCurve& curve);
  std::optional<Eigen::VectorXd> Settle(const Eigen::VectorXd& q, const Eigen::VectorXd& before);
  /// Whether tool poses leave the arm a choice. Its controller takes it, so that a curve of such an arm is only as good
  /// as what becomes of it when the tool is followed.
  bool IsRedundant() const { return scene->arm().is_redundant(); }
  bool IsRegular(const Call& call, const Eigen::VectorXd& q);
  bool SegmentIsFree(Call& call, const Eigen::VectorXd& a, const Eigen::VectorXd& b);
  void PlanByField(Call& call, const Eigen::VectorXd& q_goal);
  bool FinishField(Call& call, const std::vector<Eigen::VectorXd>& path);
  void Escape(Call& call, const Eigen::VectorXd& q_goal, const std::string& trap);
  bool KeepsClear(Call& call, const Eigen::VectorXd& q);

  std::shared_ptr<const sim::Scene> scene;
  PlannerConfig config;
  sim::Kinematics kinematics;
  double home_manipulability;
};

}  // namespace etude::plan
