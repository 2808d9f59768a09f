// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "worker/plan/planner_impl.h"

namespace etude::plan {

using internal::Fail;
using internal::kFiner;
using internal::ToolLine;
using internal::Touches;

namespace {

// steps of the tool along a line between two solutions of inverse kinematics
constexpr double kLinearStep = 0.005;  // m
constexpr double kAngularStep = 0.03;  // rad
constexpr double kJump = 0.5;          // rad a step: another branch of the kinematics
constexpr int kPaceRounds = 12;

}  // namespace

Planner::Impl::Track Planner::Impl::Follow(const ToolLine& line, const Eigen::VectorXd& q_start) {
  const int steps =
      std::max(1, static_cast<int>(std::ceil(std::max(line.length() / kLinearStep, line.angle() / kAngularStep))));
  Track track;
  track.q.push_back(q_start);
  for (int step = 1; step <= steps; ++step) {
    const double s = static_cast<double>(step) / steps;
    // from where the last step leads: a correction less than from where it ends
    const Eigen::VectorXd& last = track.q.back();
    const Eigen::VectorXd ahead = step > 1 ? 2 * last - track.q[track.q.size() - 2] : last;
    const auto q = kinematics.Solve(line.At(s), ahead);
    if (!q || (*q - track.q.back()).cwiseAbs().maxCoeff() > kJump) return track;
    track.q.push_back(*q);
    track.reached = s;
  }
  track.complete = true;
  return track;
}

bool Planner::Impl::LineIsFree(Call& call, const Track& track) {
  const double step = config.resolution / kFiner;
  const int spans = static_cast<int>(track.q.size()) - 1;
  for (int i = 0; i < spans; ++i) {
    const Eigen::VectorXd change = track.q[i + 1] - track.q[i];
    const int parts = std::max(1, static_cast<int>(std::ceil(change.cwiseAbs().maxCoeff() / step)));
    for (int part = 1; part <= parts; ++part) {
      const double along = static_cast<double>(part) / parts;
      if (const auto collision = call.checker.Check(track.q[i] + change * along, call.margin))
        return Fail(call.outcome, OutcomeKind::kNoPath,
                    fmt::format("{} at {:.0f} % of the straight path", Touches(*collision), 100 * (i + along) / spans));
    }
  }
  return true;
}

// Where a timed line asks most of a joint, relative to its speed limit.
Planner::Impl::Strain Planner::Impl::WorstStrain(const internal::LineMotion& timed, const Track& track,
                                                 double joint_limit) {
  const int spans = static_cast<int>(track.q.size()) - 1;
  Strain worst;
  for (std::size_t k = 0; k < timed.s.size(); ++k) {
    const int span = std::clamp(static_cast<int>(timed.s[k] * spans), 0, spans - 1);
    const Eigen::VectorXd rate = (track.q[span + 1] - track.q[span]) * (spans * timed.ds[k]);
    int joint = 0;
    const double excess = rate.cwiseAbs().maxCoeff(&joint) / joint_limit;
    if (excess > worst.excess) worst = {excess, timed.s[k], joint};
  }
  return worst;
}

bool Planner::Impl::TimeLine(Call& call, const ToolLine& line, const Track& track) {
  const Timer timer(call.outcome.times.parameterise);
  const Limits& asked = call.request.limits;
  double pace = 1;
  // slowing down moves the samples, so a further round sees what the one before has left
  for (int round = 0; round < kPaceRounds; ++round) {
    Limits limits = asked;
    limits.linear *= pace;
    limits.angular *= pace;
    internal::LineMotion timed = MoveAlong(line, limits, call.request.start_speed);
    Strain worst = WorstStrain(timed, track, asked.joint);
    if (worst.excess <= 1 && IsRedundant()) worst = TrackedStrain(timed.motion, track.q.front(), asked.joint);
    if (worst.excess <= 1) {
      call.outcome.kind = OutcomeKind::kStraight;
      call.outcome.reason = pace < 1 ? fmt::format("slowed to {:.0f} %", 100 * pace) : "free";
      call.outcome.motion = std::move(timed.motion);
      return true;
    }
    pace /= worst.excess * (1.005 + 0.005 * round);  // where slowing down does not do, ever more
    if (pace < internal::kSlowest)
      return Fail(call.outcome, OutcomeKind::kNotSmooth,
                  fmt::format("{} would turn at {:.1f} rad/s at {:.0f} % of the straight path",
                              scene->arm().joints[worst.joint], worst.excess * asked.joint, 100 * worst.s));
  }
  return Fail(call.outcome, OutcomeKind::kNotSmooth,
              fmt::format("joints exceed {} rad/s from the given start speed", asked.joint));
}

}  // namespace etude::plan
