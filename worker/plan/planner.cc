// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/planner.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "services/core/check.h"
#include "services/core/enum_name.h"
#include "worker/plan/planner_impl.h"

namespace etude::plan {

using collide::Collision;
using internal::Fail;
using internal::Manipulability;
using internal::ToolLine;
using internal::Touches;

namespace {

constexpr int kGoalTries = 8;      // seeds of inverse kinematics for another arm configuration
constexpr double kSingular = 0.1;  // of the manipulability at home

}  // namespace

namespace internal {

std::string Touches(const Collision& collision) {
  return fmt::format("{} {} {}", collision.body_a, collision.distance > 0 ? "comes too near to" : "touches",
                     collision.body_b);
}

double Manipulability(const Eigen::MatrixXd& J) {
  if (J.rows() == J.cols()) return J.determinant();
  // with fewer joints than rows J J^T is singular everywhere, and its determinant noise
  if (J.cols() < J.rows()) return std::sqrt(std::max(0.0, (J.transpose() * J).determinant()));
  return std::sqrt(std::max(0.0, (J * J.transpose()).determinant()));
}

bool Fail(Outcome& outcome, OutcomeKind kind, std::string reason) {
  outcome.kind = kind;
  outcome.reason = std::move(reason);
  return false;
}

}  // namespace internal

std::string_view ToString(OutcomeKind kind) {
  const std::string_view name = EnumName(kind,
                                         {{OutcomeKind::kStraight, "straight"},
                                          {OutcomeKind::kSampled, "sampled"},
                                          {OutcomeKind::kField, "field"},
                                          {OutcomeKind::kFieldEscaped, "field_escaped"},
                                          {OutcomeKind::kGoalUnreachable, "goal_unreachable"},
                                          {OutcomeKind::kGoalInCollision, "goal_in_collision"},
                                          {OutcomeKind::kStartInCollision, "start_in_collision"},
                                          {OutcomeKind::kNoPath, "no_path"},
                                          {OutcomeKind::kNotSmooth, "not_smooth"}},
                                         "");
  ETUDE_CHECK(!name.empty(), "kind {}", static_cast<int>(kind));
  return name;
}

Pose Motion::At(double step) const {
  const int before = std::clamp(static_cast<int>(step), 0, steps() - 1), after = std::min(before + 1, steps() - 1);
  return Interpolate(X_WE[before], X_WE[after], std::clamp(step - before, 0.0, 1.0));
}

bool Planner::Impl::CheckStart(Call& call) {
  const Eigen::VectorXd& q_start = call.request.q_start;
  if (const auto collision = call.checker.Check(q_start))
    return Fail(call.outcome, OutcomeKind::kStartInCollision, Touches(*collision) + " at the start");

  // a start within the margin may leave, but not come nearer
  call.margin = call.request.margin;
  while (call.margin > 0 && call.checker.Collides(q_start, call.margin)) {
    call.margin *= 0.5;
    if (call.margin < 1e-5) call.margin = 0;
  }
  const double start = Manipulability(kinematics.Jacobian(q_start));
  call.least = std::copysign(std::min(kSingular * home_manipulability, std::abs(start) / 2), start);
  return true;
}

bool Planner::Impl::IsRegular(const Call& call, const Eigen::VectorXd& q) {
  const double here = Manipulability(kinematics.Jacobian(q));
  return call.least >= 0 ? here >= call.least : here <= call.least;
}

// A free configuration for the goal: where the line ended, else near the start, else anywhere near.
std::optional<Eigen::VectorXd> Planner::Impl::FindGoal(Call& call, const Track& track) {
  const Pose& X_WE_goal = call.request.X_WE_goal;
  const Eigen::VectorXd& q_start = call.request.q_start;
  const sim::ArmInfo& arm = scene->arm();
  std::string unreachable = fmt::format("no inverse kinematics at ({:.3f}, {:.3f}, {:.3f}) m", X_WE_goal.p.x(),
                                        X_WE_goal.p.y(), X_WE_goal.p.z());
  if (call.request.method != Method::kSampled)
    unreachable += fmt::format("; the straight path ends at {:.0f} %", 100 * track.reached);
  Fail(call.outcome, OutcomeKind::kGoalUnreachable, std::move(unreachable));

  const auto accept = [&](const Eigen::VectorXd& q) {
    if (const auto collision = call.checker.Check(q, call.margin))
      return Fail(call.outcome, OutcomeKind::kGoalInCollision, Touches(*collision) + " at the goal");
    if (IsRegular(call, q)) return true;
    if (call.outcome.kind != OutcomeKind::kGoalInCollision)
      Fail(call.outcome, OutcomeKind::kNotSmooth, "the goal lies beyond a singularity of the arm");
    return false;
  };
  // the end of a line that was followed is taken as it is: TimeLine judges singularities there
  if (track.complete) {
    const auto collision = call.checker.Check(track.q.back(), call.margin);
    if (!collision) return track.q.back();
    Fail(call.outcome, OutcomeKind::kGoalInCollision, Touches(*collision) + " at the goal");
  }
  if (call.request.straight_only && track.complete) return std::nullopt;

  if (const auto q = kinematics.Solve(X_WE_goal, q_start); q && accept(*q)) return q;
  if (const auto q = kinematics.Solve(X_WE_goal, arm.q_home); q && accept(*q)) return q;
  for (int i = 0; i < kGoalTries; ++i) {
    Eigen::VectorXd seed = q_start;
    for (double& value : seed) value += call.rng.Uniform(-std::numbers::pi / 2, std::numbers::pi / 2);
    seed = seed.cwiseMax(arm.q_min).cwiseMin(arm.q_max);
    if (const auto q = kinematics.Solve(X_WE_goal, seed); q && accept(*q)) return q;
  }
  return std::nullopt;
}

void Planner::Impl::PlanStraightFirst(Call& call, const ToolLine& line, const Track& track,
                                      const Eigen::VectorXd& q_goal) {
  if (!track.complete)
    Fail(call.outcome, OutcomeKind::kNoPath,
         fmt::format("no inverse kinematics at {:.0f} % of the straight path", 100 * track.reached));
  else if (q_goal != track.q.back())
    Fail(call.outcome, OutcomeKind::kNoPath, call.outcome.reason + " of the straight path");
  else if (LineIsFree(call, track) && TimeLine(call, line, track))
    return;
  if (call.request.straight_only) return;
  GoRound(call, q_goal);
}

void Planner::Impl::PlanSampled(Call& call) {
  Track track;
  if (call.request.q_goal.size() > 0) track = {.q = {call.request.q_goal}, .complete = true, .reached = 1};
  const std::optional<Eigen::VectorXd> q_goal = FindGoal(call, track);
  if (!q_goal) return;
  Fail(call.outcome, OutcomeKind::kNoPath, "the straight path is known to be blocked");
  GoRound(call, *q_goal);
}

void Planner::Impl::GoRound(Call& call, const Eigen::VectorXd& q_goal) {
  if (!IsRegular(call, q_goal)) {
    Fail(call.outcome, OutcomeKind::kNotSmooth,
         "the goal lies beyond a singularity of the arm; " + call.outcome.reason);
    return;
  }
  Detour(call, q_goal);
}

void Planner::Impl::Plan(Call& call) {
  if (!CheckStart(call)) return;
  if (call.request.method == Method::kSampled) return PlanSampled(call);
  const ToolLine line(kinematics.X_WE(call.request.q_start), call.request.X_WE_goal);
  const Track track = Follow(line, call.request.q_start);
  if (track.complete) call.outcome.q_line_end = track.q.back();
  const std::optional<Eigen::VectorXd> q_goal = FindGoal(call, track);
  if (!q_goal) return;
  if (call.request.method == Method::kPotentialField && !call.request.straight_only)
    PlanByField(call, *q_goal);
  else
    PlanStraightFirst(call, line, track, *q_goal);
}

Planner::Planner(std::shared_ptr<const sim::Scene> scene, const PlannerConfig& config)
    : impl_(std::make_unique<Impl>(std::move(scene), config)) {}
Planner::Planner(Planner&&) noexcept = default;
Planner::~Planner() = default;

Outcome Planner::Plan(const Request& request, collide::Checker& checker, std::uint64_t seed) {
  const auto joints = static_cast<Eigen::Index>(impl_->scene->arm().joints.size());
  ETUDE_CHECK(request.q_start.size() == joints, "q_start has {} values, the arm {} joints", request.q_start.size(),
              joints);
  ETUDE_CHECK(request.clearance >= 0, "clearance={}", request.clearance);
  const std::uint64_t checks_before = checker.checks();
  Impl::Call call{request, checker, Rng(MixSeed({seed}, "plan"))};
  const Stopwatch watch;
  impl_->Plan(call);
  call.outcome.checks = checker.checks() - checks_before;
  Outcome::Times& times = call.outcome.times;
  times.plan = watch.Seconds() - times.simplify - times.parameterise;
  return std::move(call.outcome);
}

}  // namespace etude::plan
