// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/planner_impl.h"
#include "worker/plan/shortcut.h"

namespace etude::plan {

using internal::Fail;
using internal::FieldProblem;
using internal::FieldResult;

namespace {

constexpr double kWandering = 1.5;  // times the straight way in joint space: longer paths are pruned
constexpr double kPruned = 0.9;     // of what the flow kept must be left after pruning
// parts of the influence that a way out of a local minimum is to keep, in the order that they are tried
constexpr double kEscapeKeeps[] = {0.8, 0.4, 0.15};

}  // namespace

bool Planner::Impl::KeepsClear(Call& call, const Eigen::VectorXd& q) {
  if (!call.influence || call.keep <= 0) return true;
  return call.influence->PartLeft(call.checker, q, kinematics.X_WE(q)) >= call.keep;
}

// Smooths the flow's path and gives it its time; prunes it first if it wandered.
bool Planner::Impl::FinishField(Call& call, const std::vector<Eigen::VectorXd>& path) {
  const double direct = (path.back() - path.front()).norm();
  if (internal::Length(path) > kWandering * direct && Smooth(call, Shorten(call, path), OutcomeKind::kField))
    return true;
  return Smooth(call, path, OutcomeKind::kField);
}

// Around what holds the flow: a sampled path, as clear of obstacles as one is found.
void Planner::Impl::Escape(Call& call, const Eigen::VectorXd& q_goal, const std::string& trap) {
  Outcome& outcome = call.outcome;
  internal::SamplingProblem problem = MakeProblem(call, q_goal);
  call.resolution = config.resolution;
  for (const double keep : kEscapeKeeps) {
    call.keep = keep;
    problem.max_samples = config.max_iterations / 8;
    const internal::SamplingResult result = internal::SamplePath(problem, call.rng);
    outcome.samples += result.samples;
    if (result.path.empty() || !Smooth(call, Shorten(call, result.path), OutcomeKind::kFieldEscaped)) continue;
    outcome.reason = trap;
    return;
  }
  call.influence.reset();
  Fail(outcome, OutcomeKind::kNoPath, trap);
  Detour(call, q_goal);
  if (outcome.kind == OutcomeKind::kSampled) outcome.kind = OutcomeKind::kFieldEscaped;
}

void Planner::Impl::PlanByField(Call& call, const Eigen::VectorXd& q_goal) {
  const Request& request = call.request;
  if (!IsRegular(call, q_goal)) {
    Fail(call.outcome, OutcomeKind::kNotSmooth, "the goal lies beyond a singularity of the arm");
    return;
  }
  const Eigen::VectorXd& q_start = request.q_start;
  call.influence.emplace(call.checker, internal::Influence::Place{q_start, kinematics.X_WE(q_start)},
                         internal::Influence::Place{q_goal, request.X_WE_goal}, request.clearance, request.obstacles);
  call.resolution = config.resolution;

  FieldProblem problem{.q_start = q_start,
                       .X_WE_goal = request.X_WE_goal,
                       .q_min = scene->arm().q_min,
                       .q_max = scene->arm().q_max,
                       .influence = &*call.influence,
                       .is_free = [this, &call](const Eigen::VectorXd& q) {
                         return IsRegular(call, q) && !call.checker.Collides(q, call.margin);
                       }};
  if (IsRedundant())
    problem.settle = [this](const Eigen::VectorXd& q) { return kinematics.Solve(kinematics.X_WE(q), q).value_or(q); };
  const FieldResult field = internal::FollowField(problem, kinematics, call.checker);
  if (!field.reached) return Escape(call, q_goal, field.trap);
  if (field.path.size() < 2) {  // it is there already: nothing to smooth
    call.outcome.kind = OutcomeKind::kField;
    call.outcome.motion =
        StraightMotion(kinematics.X_WE(q_start), request.X_WE_goal, request.limits, request.start_speed);
    call.outcome.reason = "field, there already";
    return;
  }
  call.keep = kPruned * field.keep;
  if (FinishField(call, field.path)) {
    call.outcome.reason = fmt::format("field, {:.0f} % of the clearance kept", 100 * field.keep);
    return;
  }
  Escape(call, q_goal, "no smooth path along the field");
}

}  // namespace etude::plan
