// SPDX-License-Identifier: Apache-2.0
#include "worker/task/stage_planner.h"

#include <algorithm>
#include <cmath>

#include "services/core/check.h"

namespace etude::task {
namespace {

constexpr int kFollowStride = 10;     // steps between two solutions while following a motion
constexpr double kKeepBehind = 0.10;  // m between hand and the objects that it passes
constexpr double kPassing = 0.12;     // m beside the path where an object counts as passed

int RampSteps(const plan::Limits& limits) {
  return static_cast<int>(std::ceil(limits.linear / limits.linear_accel * kControlRate));
}

}  // namespace

plan::Motion Join(const plan::Motion& a, const plan::Motion& b, int overlap) {
  overlap = std::clamp(overlap, 0, std::min(a.steps(), b.steps()));
  plan::Motion joined = a;
  const int first = a.steps() - overlap;
  for (int i = 0; i < overlap; ++i) {
    Pose& X_WE = joined.X_WE[first + i];
    X_WE.p += b.X_WE[i].p - b.X_WE[0].p;
    X_WE.q = (b.X_WE[i].q * b.X_WE[0].q.conjugate() * X_WE.q).normalized();
    joined.V_WE[first + i] += b.V_WE[i];
  }
  joined.X_WE.insert(joined.X_WE.end(), b.X_WE.begin() + overlap, b.X_WE.end());
  joined.V_WE.insert(joined.V_WE.end(), b.V_WE.begin() + overlap, b.V_WE.end());
  return joined;
}

StagePlanner::StagePlanner(std::shared_ptr<const sim::Scene> scene, collide::Checker* checker)
    : kinematics_(scene), checker_(checker), planner_(scene) {}

std::optional<Eigen::VectorXd> StagePlanner::EndOf(const plan::Motion& motion, const Eigen::VectorXd& q_start) {
  Eigen::VectorXd q = q_start;
  for (int i = 0; i < motion.steps(); ++i) {
    if (i % kFollowStride != 0 && i + 1 != motion.steps()) continue;
    const auto next = kinematics_.Solve(motion.X_WE[i], q);
    if (!next) return std::nullopt;
    q = *next;
  }
  return q;
}

namespace {

plan::Request StraightRequest(const Eigen::VectorXd& q_start, const Pose& goal, const Stage& stage) {
  return {.q_start = q_start, .X_WE_goal = goal, .limits = stage.limits, .margin = stage.margin, .straight_only = true};
}

}  // namespace

plan::Request StagePlanner::RequestOf(const Eigen::VectorXd& q_start, const Pose& goal, const Stage& stage,
                                      const Surroundings& around) {
  plan::Request request = StraightRequest(q_start, goal, stage);
  request.straight_only = stage.straight_only;
  if (stage.clearance > 0) {
    request.method = plan::Method::kPotentialField;
    request.clearance = stage.clearance;
    request.obstacles = around.avoid;
  }
  return request;
}

std::string_view PlannedStage::way() const {
  if (detour) return "detour";
  switch (outcome.kind) {
    case plan::OutcomeKind::kStraight:
      return "line";
    case plan::OutcomeKind::kSampled:
      return "rrt";
    case plan::OutcomeKind::kField:
      return "field";
    case plan::OutcomeKind::kFieldEscaped:
      return "field_escaped";
    default:
      ETUDE_CHECK(false, "kind={}", plan::ToString(outcome.kind));
      return "";
  }
}

PlannedStage StagePlanner::Plan(const Eigen::VectorXd& q_start, const Pose& goal, const Stage& stage,
                                const Surroundings& around, std::uint64_t seed) {
  PlannedStage planned;
  plan::Request request = RequestOf(q_start, goal, stage, around);
  if (stage.clearance == 0) {
    PlannedStage line = Line(q_start, goal, stage, seed);
    if (line.planned() || stage.straight_only) return line;
    planned.blocked = line.outcome.reason;
    if (auto detour = Detour(q_start, goal, stage, around, seed)) {
      detour->blocked = planned.blocked;
      return *detour;
    }
    request.method = plan::Method::kSampled;
    request.q_goal = line.outcome.q_line_end;
  }
  planned.outcome = planner_.Plan(request, *checker_, seed);
  return Followed(std::move(planned), q_start);
}

PlannedStage StagePlanner::Followed(PlannedStage planned, const Eigen::VectorXd& q_start) {
  if (!planned.planned()) return planned;
  if (const auto q_end = EndOf(planned.outcome.motion, q_start)) {
    planned.q_end = *q_end;
  } else {
    planned.outcome.kind = plan::OutcomeKind::kNotSmooth;
    planned.outcome.reason = "inverse kinematics lost on the path";
  }
  return planned;
}

PlannedStage StagePlanner::Line(const Eigen::VectorXd& q_start, const Pose& goal, const Stage& stage,
                                std::uint64_t seed) {
  PlannedStage planned;
  planned.outcome = planner_.Plan(StraightRequest(q_start, goal, stage), *checker_, seed);
  return Followed(std::move(planned), q_start);
}

std::optional<PlannedStage> StagePlanner::ThroughPoints(const Eigen::VectorXd& q_start, const std::vector<Pose>& points,
                                                        const Stage& stage, std::uint64_t seed) {
  PlannedStage planned;
  planned.q_end = q_start;
  std::uint64_t checks = 0;
  for (const Pose& point : points) {
    PlannedStage next = Line(planned.q_end, point, stage, seed);
    if (!next.planned()) return std::nullopt;
    checks += next.outcome.checks;
    if (planned.outcome.motion.steps() == 0) {
      planned.outcome = std::move(next.outcome);
    } else {
      JoinIfFree(planned.outcome.motion, next.outcome.motion, stage.limits, planned.q_end);
    }
    planned.q_end = next.q_end;
  }
  planned.outcome.checks = checks;
  planned.detour = true;
  return planned;
}

std::optional<PlannedStage> StagePlanner::Detour(const Eigen::VectorXd& q_start, const Pose& goal, const Stage& stage,
                                                 const Surroundings& around, std::uint64_t seed) {
  const Pose start = kinematics_.X_WE(q_start);
  Pose before = goal, beside = start;
  if (stage.detours_over) {
    before.p.z() = beside.p.z() = std::max({start.p.z(), goal.p.z(), around.over});
  } else {
    const double left = std::min(start.p.x(), goal.p.x()) - kPassing;
    const double right = std::max(start.p.x(), goal.p.x()) + kPassing;
    double y = std::min(start.p.y(), goal.p.y());
    for (const auto& p : around.hands)
      if (p.x() > left && p.x() < right) y = std::min(y, p.y() - kKeepBehind);
    before.p.y() = beside.p.y() = y;
  }
  if (auto one = ThroughPoints(q_start, {before, goal}, stage, seed)) return one;
  return ThroughPoints(q_start, {beside, before, goal}, stage, seed);
}

int StagePlanner::JoinIfFree(plan::Motion& a, const plan::Motion& b, const plan::Limits& limits,
                             const Eigen::VectorXd& q_corner) {
  const int most = std::min({RampSteps(limits), a.steps() / 2, b.steps() / 2});
  for (const int overlap : {most, most / 2}) {
    if (overlap < 1) continue;
    plan::Motion joined = Join(a, b, overlap);
    if (!CornerIsFree(joined, a.steps() - overlap, overlap, limits.joint, q_corner)) continue;
    a = std::move(joined);
    return overlap;
  }
  a = Join(a, b, 0);
  return 0;
}

// Velocities add up in a corner, so the joints' speed is looked at again.
bool StagePlanner::CornerIsFree(const plan::Motion& motion, int first, int steps, double joint_speed,
                                const Eigen::VectorXd& q_corner) {
  Eigen::VectorXd q = q_corner;
  for (int i = first + steps / 4; i < first + steps; i += std::max(1, steps / 4)) {
    const auto here = kinematics_.Solve(motion.X_WE[i], q);
    const auto next = here ? kinematics_.Solve(motion.X_WE[i + 1], *here) : here;
    if (!next || checker_->Check(*here)) return false;
    if ((*next - *here).cwiseAbs().maxCoeff() * kControlRate > joint_speed) return false;
    q = *here;
  }
  return true;
}

}  // namespace etude::task
