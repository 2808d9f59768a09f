// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "services/core/check.h"
#include "worker/plan/planner_impl.h"

namespace etude::plan {

using internal::Fail;
using internal::Touches;

namespace {

// between the poses of a motion that are solved for the arm
constexpr double kStride = 0.02;      // m
constexpr double kStrideTurn = 0.08;  // rad
constexpr double kCheckStep = 0.01;   // rad of a joint between states that are checked
constexpr double kFarJump = 0.6;      // rad between neighbours: not the same branch of the arm

// As Motion::At.
Eigen::Matrix<double, 6, 1> VelocityAt(const Motion& motion, double at) {
  const int i = std::clamp(static_cast<int>(at), 0, motion.steps() - 1), j = std::min(i + 1, motion.steps() - 1);
  return motion.V_WE[i] + std::clamp(at - i, 0.0, 1.0) * (motion.V_WE[j] - motion.V_WE[i]);
}

// The next sample that is worth a look, `from` < next < steps.
int NextSample(const Motion& motion, int from) {
  int next = from + 1;
  while (next + 1 < motion.steps() && (motion.X_WE[next].p - motion.X_WE[from].p).norm() < kStride &&
         AngleBetween(motion.X_WE[next].q, motion.X_WE[from].q) < kStrideTurn)
    ++next;
  return next;
}

void Append(Motion& motion, const Motion& next) {
  motion.X_WE.insert(motion.X_WE.end(), next.X_WE.begin() + 1, next.X_WE.end());
  motion.V_WE.insert(motion.V_WE.end(), next.V_WE.begin() + 1, next.V_WE.end());
}

}  // namespace

Motion Brake(const Motion& motion, int step, const Limits& limits) {
  ETUDE_CHECK(step >= 0 && step < motion.steps(), "step {} of {}", step, motion.steps());
  const Eigen::Matrix<double, 6, 1>& V_WE = motion.V_WE[step];
  const double stop_s =
      std::max(V_WE.head<3>().norm() / limits.linear_accel, V_WE.tail<3>().norm() / limits.angular_accel);
  const int steps = static_cast<int>(std::ceil(stop_s * kControlRate));
  Motion brake;
  brake.X_WE.push_back(motion.X_WE[step]);
  brake.V_WE.push_back(V_WE);
  // the rate of passing through the motion falls from 1 to 0: as far as half of that time goes at full rate
  for (int k = 1; k <= steps; ++k) {
    const double at = step + k - 0.5 * k * k / steps;
    brake.X_WE.push_back(motion.At(at));
    brake.V_WE.push_back(VelocityAt(motion, at) * (1 - static_cast<double>(k) / steps));
  }
  brake.V_WE.back().setZero();
  return brake;
}

std::optional<Blockage> Planner::FindBlockage(const Motion& motion, int from_step, const Eigen::VectorXd& q,
                                              collide::Checker& checker, double margin) {
  ETUDE_CHECK(from_step >= 0 && from_step < motion.steps(), "step {} of {}", from_step, motion.steps());
  sim::Kinematics& kinematics = impl_->kinematics;
  const auto lost = [](int step) { return Blockage{step, fmt::format("no inverse kinematics at step {}", step)}; };
  auto before = kinematics.Solve(motion.X_WE[from_step], q);
  if (!before) return lost(from_step);
  if (const auto collision = checker.Check(*before))
    return Blockage{from_step, fmt::format("{} at step {}", Touches(*collision), from_step)};
  while (margin > 0 && checker.Collides(*before, margin)) margin = margin < 1e-5 ? 0 : margin / 2;

  for (int step = from_step; step + 1 < motion.steps();) {
    const int next = NextSample(motion, step);
    const auto after = kinematics.Solve(motion.X_WE[next], *before);
    if (!after || (*after - *before).cwiseAbs().maxCoeff() > kFarJump) return lost(next);
    const int parts = std::max(1, static_cast<int>(std::ceil((*after - *before).cwiseAbs().maxCoeff() / kCheckStep)));
    for (int part = 1; part <= parts; ++part) {
      const double along = static_cast<double>(part) / parts;
      if (const auto collision = checker.Check(*before + (*after - *before) * along, margin)) {
        const int at = step + static_cast<int>(std::lround((next - step) * along));
        return Blockage{at, fmt::format("{} at step {}", Touches(*collision), at)};
      }
    }
    before = after;
    step = next;
  }
  return std::nullopt;
}

Outcome Planner::Replan(const Motion& current, int step, const Eigen::VectorXd& q, const Request& request,
                        collide::Checker& checker, std::uint64_t seed) {
  Motion brake = Brake(current, step, request.limits);
  Outcome outcome;
  if (const auto blockage = FindBlockage(brake, 0, q, checker, 0)) {
    Fail(outcome, OutcomeKind::kStartInCollision, "while braking: " + blockage->reason);
    return outcome;
  }
  Request from_rest = request;
  from_rest.start_speed = 0;
  Eigen::VectorXd q_end = q;
  for (int at = 0; at + 1 < brake.steps();) {
    at = NextSample(brake, at);
    q_end = impl_->kinematics.Solve(brake.X_WE[at], q_end).value_or(q_end);
  }
  from_rest.q_start = impl_->kinematics.Solve(brake.X_WE.back(), q_end).value_or(q_end);
  outcome = Plan(from_rest, checker, seed);
  if (!outcome.planned()) return outcome;
  Append(brake, outcome.motion);
  outcome.motion = std::move(brake);
  return outcome;
}

}  // namespace etude::plan
