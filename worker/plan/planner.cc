// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/planner.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "services/core/check.h"
#include "services/core/rng.h"
#include "worker/plan/joint_curve.h"
#include "worker/plan/line_motion.h"
#include "worker/plan/retime.h"
#include "worker/plan/sampling.h"
#include "worker/plan/shortcut.h"

namespace etude::plan {

using collide::Checker;
using collide::Collision;
using internal::JointCurve;
using internal::ToolLine;

namespace {

// steps of the tool along a line between two solutions of inverse kinematics
constexpr double kLinearStep = 0.005;  // m
constexpr double kAngularStep = 0.03;  // rad
constexpr double kJump = 0.5;          // rad a step: another branch of the kinematics
constexpr double kSlowest = 0.2;       // of the asked speed; slower is as good as not smooth
constexpr int kGoalTries = 8;          // seeds of inverse kinematics for another arm configuration
constexpr int kShortcuts = 60;
constexpr int kPaceRounds = 6;
// more than the margin is kept while sampling, else smoothing has no room where shortcuts graze
constexpr double kRoom = 0.01;     // m
constexpr double kSingular = 0.1;  // of the manipulability at home
// a quarter of `resolution` between the states of what is returned
constexpr int kFiner = 4;

std::string Touches(const Collision& collision) {
  return fmt::format("{} {} {}", collision.body_a, collision.distance > 0 ? "comes too near to" : "touches",
                     collision.body_b);
}

// Signed for a square Jacobian, so that its sign tells on which side of a singularity q is.
double Manipulability(const Eigen::MatrixXd& J) {
  if (J.rows() == J.cols()) return J.determinant();
  return std::sqrt(std::max(0.0, (J * J.transpose()).determinant()));
}

}  // namespace

std::string_view ToString(OutcomeKind kind) {
  switch (kind) {
    case OutcomeKind::kStraight:
      return "straight";
    case OutcomeKind::kSampled:
      return "sampled";
    case OutcomeKind::kGoalUnreachable:
      return "goal_unreachable";
    case OutcomeKind::kGoalInCollision:
      return "goal_in_collision";
    case OutcomeKind::kStartInCollision:
      return "start_in_collision";
    case OutcomeKind::kNoPath:
      return "no_path";
    case OutcomeKind::kNotSmooth:
      return "not_smooth";
  }
  ETUDE_CHECK(false, "kind {}", static_cast<int>(kind));
  return "";
}

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
    Checker& checker;
    Rng rng;
    double margin = 0;
    double room = 0;        ///< kept beyond the margin while sampling
    double resolution = 0;  ///< while sampling
    double least = 0;       ///< manipulability below this is singular; signed like the start's
    Outcome outcome{};
  };

  Impl(std::shared_ptr<const sim::Scene> scene_in, const PlannerConfig& config_in)
      : scene(std::move(scene_in)),
        config(config_in),
        kinematics(scene),
        home_manipulability(std::abs(Manipulability(kinematics.Jacobian(scene->arm().q_home)))) {}

  void Plan(Call& call);
  bool CheckStart(Call& call);
  Track Follow(const ToolLine& line, const Eigen::VectorXd& q_start);
  bool LineIsFree(Call& call, const Track& track);
  static Strain WorstStrain(const internal::LineMotion& timed, const Track& track, double joint_limit);
  bool TimeLine(Call& call, const ToolLine& line, const Track& track);
  std::optional<Eigen::VectorXd> FindGoal(Call& call, const Track& track);
  double FindRoom(Call& call, const Eigen::VectorXd& q_goal);
  internal::SamplingProblem MakeProblem(Call& call, const Eigen::VectorXd& q_goal);
  void Detour(Call& call, const Eigen::VectorXd& q_goal);
  bool Smooth(Call& call, const std::vector<Eigen::VectorXd>& path);
  bool CurveIsFree(Call& call, const JointCurve& curve);
  bool IsRegular(const Call& call, const Eigen::VectorXd& q);
  bool SegmentIsFree(Call& call, const Eigen::VectorXd& a, const Eigen::VectorXd& b);

  std::shared_ptr<const sim::Scene> scene;
  PlannerConfig config;
  sim::Kinematics kinematics;
  double home_manipulability;
};

namespace {

bool Fail(Outcome& outcome, OutcomeKind kind, std::string reason) {
  outcome.kind = kind;
  outcome.reason = std::move(reason);
  return false;
}

}  // namespace

bool Planner::Impl::CheckStart(Call& call) {
  const Eigen::VectorXd& q_start = call.request.q_start;
  if (const auto collision = call.checker.Check(q_start))
    return Fail(call.outcome, OutcomeKind::kStartInCollision, Touches(*collision) + " at the start");

  // a start within the margin may leave, but not come nearer
  call.margin = call.request.margin;
  while (call.margin > 0 && call.checker.Check(q_start, call.margin)) {
    call.margin *= 0.5;
    if (call.margin < 1e-5) call.margin = 0;
  }
  const double start = Manipulability(kinematics.Jacobian(q_start));
  call.least = std::copysign(std::min(kSingular * home_manipulability, std::abs(start) / 2), start);
  return true;
}

Planner::Impl::Track Planner::Impl::Follow(const ToolLine& line, const Eigen::VectorXd& q_start) {
  const int steps =
      std::max(1, static_cast<int>(std::ceil(std::max(line.length() / kLinearStep, line.angle() / kAngularStep))));
  Track track;
  track.q.push_back(q_start);
  for (int step = 1; step <= steps; ++step) {
    const double s = static_cast<double>(step) / steps;
    const auto q = kinematics.Solve(line.At(s), track.q.back());
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
  const Limits& asked = call.request.limits;
  double pace = 1;
  // slowing down moves the samples, so a further round sees what the one before has left
  for (int round = 0; round < kPaceRounds; ++round) {
    Limits limits = asked;
    limits.linear *= pace;
    limits.angular *= pace;
    internal::LineMotion timed = MoveAlong(line, limits, call.request.start_speed);
    const Strain worst = WorstStrain(timed, track, asked.joint);
    if (worst.excess <= 1) {
      call.outcome.kind = OutcomeKind::kStraight;
      call.outcome.reason = pace < 1 ? fmt::format("slowed to {:.0f} %", 100 * pace) : "free";
      call.outcome.motion = std::move(timed.motion);
      return true;
    }
    pace /= worst.excess * 1.005;
    if (pace < kSlowest)
      return Fail(call.outcome, OutcomeKind::kNotSmooth,
                  fmt::format("{} would turn at {:.1f} rad/s at {:.0f} % of the straight path",
                              scene->arm().joints[worst.joint], worst.excess * asked.joint, 100 * worst.s));
  }
  return Fail(call.outcome, OutcomeKind::kNotSmooth,
              fmt::format("joints exceed {} rad/s from the given start speed", asked.joint));
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
  Fail(call.outcome, OutcomeKind::kGoalUnreachable,
       fmt::format("no inverse kinematics at ({:.3f}, {:.3f}, {:.3f}) m; the straight path ends at {:.0f} %",
                   X_WE_goal.p.x(), X_WE_goal.p.y(), X_WE_goal.p.z(), 100 * track.reached));

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

bool Planner::Impl::SegmentIsFree(Call& call, const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  // singularities are wide against the steps of a tree: both ends and thirds tell
  for (const double along : {1.0, 1.0 / 3, 2.0 / 3})
    if (!IsRegular(call, a + (b - a) * along)) return false;
  return !call.checker.CheckSegment(a, b, call.resolution, call.margin + call.room);
}

bool Planner::Impl::CurveIsFree(Call& call, const JointCurve& curve) {
  const double step = config.resolution / kFiner;
  const int parts = std::max(8, static_cast<int>(std::ceil(curve.length() / step)));
  for (int i = 0; i <= parts; ++i) {
    const Eigen::VectorXd q = curve.At(static_cast<double>(i) / parts).q;
    if (call.checker.Check(q, call.margin) || !IsRegular(call, q)) return false;
  }
  return true;
}

// The widest smoothing that stays free. @returns false when none does
bool Planner::Impl::Smooth(Call& call, const std::vector<Eigen::VectorXd>& path) {
  for (double spacing = 0.32; spacing >= 0.02; spacing /= 2) {
    const JointCurve curve(path, spacing);
    if (!CurveIsFree(call, curve)) continue;
    auto motion =
        internal::Retime(curve, kinematics, call.request.limits, call.request.start_speed, call.request.X_WE_goal);
    if (!motion) continue;
    call.outcome.kind = OutcomeKind::kSampled;
    call.outcome.motion = std::move(*motion);
    return true;
  }
  return false;
}

// As much as start and goal can keep, up to kRoom.
double Planner::Impl::FindRoom(Call& call, const Eigen::VectorXd& q_goal) {
  constexpr double kLeast = 1e-3;
  for (double room = kRoom; room > kLeast; room /= 2)
    if (!call.checker.Check(call.request.q_start, call.margin + room) &&
        !call.checker.Check(q_goal, call.margin + room))
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
    return IsRegular(call, q) && !call.checker.Check(q, call.margin + call.room);
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
    const auto shorter = internal::Shortcut(result.path, kShortcuts, call.rng, problem.is_segment_free);
    if (!Smooth(call, shorter)) continue;
    outcome.reason = "around: " + blocked;
    return;
  }
  if (found)
    Fail(outcome, OutcomeKind::kNotSmooth, "no smooth path around: " + blocked);
  else
    Fail(outcome, OutcomeKind::kNoPath, fmt::format("no path in {} samples around: {}", outcome.samples, blocked));
}

void Planner::Impl::Plan(Call& call) {
  if (!CheckStart(call)) return;
  const ToolLine line(kinematics.X_WE(call.request.q_start), call.request.X_WE_goal);
  const Track track = Follow(line, call.request.q_start);
  const std::optional<Eigen::VectorXd> q_goal = FindGoal(call, track);
  if (!q_goal) return;

  if (!track.complete)
    Fail(call.outcome, OutcomeKind::kNoPath,
         fmt::format("no inverse kinematics at {:.0f} % of the straight path", 100 * track.reached));
  else if (*q_goal != track.q.back())
    Fail(call.outcome, OutcomeKind::kNoPath, call.outcome.reason + " of the straight path");
  else if (LineIsFree(call, track) && TimeLine(call, line, track))
    return;
  if (call.request.straight_only) return;

  if (!IsRegular(call, *q_goal)) {
    Fail(call.outcome, OutcomeKind::kNotSmooth,
         "the goal lies beyond a singularity of the arm; " + call.outcome.reason);
    return;
  }
  Detour(call, *q_goal);
}

Planner::Planner(std::shared_ptr<const sim::Scene> scene, const PlannerConfig& config)
    : impl_(std::make_unique<Impl>(std::move(scene), config)) {}
Planner::Planner(Planner&&) noexcept = default;
Planner::~Planner() = default;

Outcome Planner::Plan(const Request& request, collide::Checker& checker, std::uint64_t seed) {
  const auto joints = static_cast<Eigen::Index>(impl_->scene->arm().joints.size());
  ETUDE_CHECK(request.q_start.size() == joints, "q_start has {} values, the arm {} joints", request.q_start.size(),
              joints);
  const std::uint64_t checks_before = checker.checks();
  Impl::Call call{request, checker, Rng(MixSeed({seed}, "plan"))};
  impl_->Plan(call);
  call.outcome.checks = checker.checks() - checks_before;
  return std::move(call.outcome);
}

}  // namespace etude::plan
