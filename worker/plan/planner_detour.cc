// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>

#include "worker/plan/planner_impl.h"
#include "worker/plan/retime.h"
#include "worker/plan/shortcut.h"
#include "worker/plan/tracking.h"

namespace etude::plan {

using internal::Fail;
using internal::JointCurve;
using internal::kFiner;

namespace {

constexpr int kShortcuts = 60;
// more than the margin is kept while sampling, else smoothing has no room where shortcuts graze
constexpr double kRoom = 0.01;       // m
constexpr double kFollowJump = 0.3;  // rad between neighbours: another branch of the arm
constexpr double kClearStep = 0.04;  // rad between states whose clearance is looked at

}  // namespace

bool Planner::Impl::SegmentIsFree(Call& call, const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  // singularities are wide against the steps of a tree: both ends and thirds tell
  for (const double along : {1.0, 1.0 / 3, 2.0 / 3})
    if (!IsRegular(call, a + (b - a) * along)) return false;
  if (call.checker.CheckSegment(a, b, call.resolution, call.margin + call.room)) return false;
  if (!call.influence) return true;
  const int parts = std::max(1, static_cast<int>(std::ceil((b - a).cwiseAbs().maxCoeff() / kClearStep)));
  for (int i = 1; i <= parts; ++i)
    if (!KeepsClear(call, a + (b - a) * (static_cast<double>(i) / parts))) return false;
  return true;
}

// The arm at a place of the curve, as it is when its controller follows the tool there from `before`; nothing where it
// is lost.
std::optional<Eigen::VectorXd> Planner::Impl::Settle(const Eigen::VectorXd& q, const Eigen::VectorXd& before) {
  if (!IsRedundant()) return q;
  auto settled = kinematics.Solve(kinematics.X_WE(q), before);
  if (settled && (*settled - before).cwiseAbs().maxCoeff() > kFollowJump) settled.reset();
  return settled;
}

bool Planner::Impl::CurveIsFree(Call& call, const JointCurve& curve) {
  const Timer timer(call.outcome.times.simplify);
  const double step = config.resolution / kFiner;
  // inverse kinematics takes as long as several checks: what is between its states is interpolated
  const int between = IsRedundant() ? kFiner : 1;
  const int parts = std::max(8, static_cast<int>(std::ceil(curve.length() / (step * between))));
  Eigen::VectorXd before = curve.At(0).q;
  for (int i = 0; i < parts; ++i) {
    const auto after = Settle(curve.At(static_cast<double>(i + 1) / parts).q, before);
    if (!after) return false;
    for (int k = 1; k <= between; ++k) {
      const Eigen::VectorXd q = before + static_cast<double>(k) / between * (*after - before);
      if (call.checker.Collides(q, call.margin) || !IsRegular(call, q)) return false;
      if ((i * between + k) % kFiner == 1 && !KeepsClear(call, q)) return false;
    }
    before = *after;
  }
  return true;
}

Planner::Impl::Strain Planner::Impl::TrackedStrain(const Motion& motion, const Eigen::VectorXd& q_start,
                                                   double joint_limit) {
  const Eigen::VectorXd& speed = scene->arm().planned_speed;
  const Eigen::VectorXd limit = speed * (joint_limit / speed.minCoeff());
  const auto velocities = TrackedVelocities(kinematics, scene->arm(), motion, q_start);
  Strain worst;
  for (std::size_t k = 0; k < velocities.size(); ++k) {
    int joint = 0;
    const double excess = velocities[k].cwiseAbs().cwiseQuotient(limit).maxCoeff(&joint);
    if (excess > worst.excess) worst = {excess, static_cast<double>(k) / static_cast<double>(velocities.size()), joint};
  }
  return worst;
}

// As fast as the curve's joints allow, and those that a redundant arm's controller makes of it.
std::optional<Motion> Planner::Impl::TimeCurve(Call& call, const JointCurve& curve) {
  constexpr int kRounds = 8;
  double pace = 1;
  for (int round = 0; round < kRounds && pace > internal::kSlowest; ++round) {
    Limits limits = call.request.limits;
    for (double* limit : {&limits.linear, &limits.angular, &limits.joint}) *limit *= pace;
    auto motion = internal::Retime(curve, kinematics, limits, call.request.start_speed, call.request.X_WE_goal);
    if (!motion || !IsRedundant()) return motion;
    const Strain worst = TrackedStrain(*motion, call.request.q_start, call.request.limits.joint);
    if (worst.excess <= 1) return motion;
    pace /= worst.excess * 1.01;
  }
  return std::nullopt;
}

// The widest smoothing that stays free. @returns false when none does
bool Planner::Impl::Smooth(Call& call, const std::vector<Eigen::VectorXd>& path, OutcomeKind kind) {
  for (double spacing = 0.32; spacing >= 0.02; spacing /= 2) {
    const JointCurve curve(path, spacing);
    if (!CurveIsFree(call, curve)) continue;
    const Timer timer(call.outcome.times.parameterise);
    auto motion = TimeCurve(call, curve);
    if (!motion) continue;
    call.outcome.kind = kind;
    call.outcome.motion = std::move(*motion);
    return true;
  }
  return false;
}

std::vector<Eigen::VectorXd> Planner::Impl::Shorten(Call& call, const std::vector<Eigen::VectorXd>& path) {
  const Timer timer(call.outcome.times.simplify);
  return internal::Shortcut(path, kShortcuts, call.rng,
                            [this, &call](const auto& a, const auto& b) { return SegmentIsFree(call, a, b); });
}

// As much as start and goal can keep, up to kRoom.
double Planner::Impl::FindRoom(Call& call, const Eigen::VectorXd& q_goal) {
  constexpr double kLeast = 1e-3;
  for (double room = kRoom; room > kLeast; room /= 2)
    if (!call.checker.Collides(call.request.q_start, call.margin + room) &&
        !call.checker.Collides(q_goal, call.margin + room))
      return room;
  return 0;
}

internal::SamplingProblem Planner::Impl::MakeProblem(Call& call, const Eigen::VectorXd& q_goal) {
  const Eigen::VectorXd& q_start = call.request.q_start;
  const sim::ArmInfo& arm = scene->arm();
  internal::SamplingProblem problem;
  problem.q_start = q_start;
  problem.q_goal = q_goal;

  // half a turn around start and goal: joints that may turn further need not; a start a hair beyond
  // a limit must still be inside
  const Eigen::VectorXd low = q_start.cwiseMin(q_goal), high = q_start.cwiseMax(q_goal);
  problem.lower = (low.array() - std::numbers::pi).matrix().cwiseMax(arm.q_min).cwiseMin(low);
  problem.upper = (high.array() + std::numbers::pi).matrix().cwiseMin(arm.q_max).cwiseMax(high);
  problem.is_free = [this, &call](const Eigen::VectorXd& q) {
    return IsRegular(call, q) && !call.checker.Collides(q, call.margin + call.room) && KeepsClear(call, q);
  };
  problem.is_segment_free = [this, &call](const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
    return SegmentIsFree(call, a, b);
  };
  return problem;
}

void Planner::Impl::Detour(Call& call, const Eigen::VectorXd& q_goal) {
  Outcome& outcome = call.outcome;
  const std::string blocked = outcome.reason;
  internal::SamplingProblem problem = MakeProblem(call, q_goal);
  call.room = FindRoom(call, q_goal);
  call.resolution = config.resolution;

  // Smooth finds a path that slips between the states checked; the second search looks closer, and
  // through gaps that the first one's room had closed. Each may use half of the budget.
  bool found = false;
  for (int round = 0; round < 2; ++round, call.resolution /= kFiner, call.room /= kFiner) {
    problem.max_samples = round == 0 ? (config.max_iterations + 1) / 2 : config.max_iterations - outcome.samples;
    const internal::SamplingResult result = internal::SamplePath(problem, call.rng);
    outcome.samples += result.samples;
    if (result.path.empty()) continue;
    found = true;
    const auto shorter = Shorten(call, result.path);
    if (!Smooth(call, shorter, OutcomeKind::kSampled)) continue;
    outcome.reason = "around: " + blocked;
    return;
  }
  if (found)
    Fail(outcome, OutcomeKind::kNotSmooth, "no smooth path around: " + blocked);
  else
    Fail(outcome, OutcomeKind::kNoPath, fmt::format("no path in {} samples around: {}", outcome.samples, blocked));
}

}  // namespace etude::plan
