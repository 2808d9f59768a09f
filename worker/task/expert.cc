// SPDX-License-Identifier: Apache-2.0
#include "worker/task/expert.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "worker/task/goals.h"
#include "worker/task/rehearsal.h"

namespace etude::task {
namespace {

constexpr double kDropDistance = 0.035;   // m that a held object may shift in the hand
constexpr double kOver = 0.03;            // m above everything on a way over the objects
constexpr int kWatchSteps = 10;           // steps between two looks at what has to be avoided
constexpr double kAvoidMargin = 0.02;     // m kept from everything where the field does not lead on
constexpr double kMoved = 0.005;          // m that it may move before that counts
constexpr double kGoalTolerance = 0.015;  // m between hand and goal when a stage counts as done
constexpr int kSettleSteps = 40;          // at most, to come within it

Verdict Failed(AttemptOutcome outcome, std::string reason) { return {outcome, std::move(reason)}; }

}  // namespace

Expert::Expert(Session* session, StagePlanner* planner, collide::Checker* checker,
               const RandomizationSpec& randomization, std::uint64_t seed)
    : session_(session),
      planner_(planner),
      checker_(checker),
      randomization_(randomization),
      seed_(seed),
      push_rng_(MixSeed({seed}, "push")),
      stages_(StagesOf(session->config().task, session->shapes())),
      push_drawn_(stages_.size(), false),
      reference_(session->world().X_WE()) {
  for (const auto& stage : stages_) session_->episode().stage_names.push_back(stage.name);
}

Verdict Expert::Run() {
  int stage = 0;
  while (stage < static_cast<int>(stages_.size())) {
    Verdict verdict;
    if (stages_[stage].moves()) {
      Piece piece;
      verdict = PlanPiece(stage, piece);
      if (verdict.ok()) verdict = PlayPiece(piece, stage);
    } else {
      verdict = PlayWait(stage++);
    }
    if (!verdict.ok()) return verdict;
  }
  return FinalCheck();
}

Situation Expert::Now() const {
  const std::string& target = session_->config().target;
  const std::string& reference = session_->config().reference;
  Situation now{.shapes = &session_->shapes(),
                .target = target,
                .reference = reference,
                .X_WO = session_->world().ObjectPose(target),
                .X_WE = reference_,
                .X_EO = X_EO_};
  if (!reference.empty()) now.X_WR = session_->world().ObjectPose(reference);
  return now;
}

Surroundings Expert::Around(const Situation& now) const {
  const Shapes& shapes = session_->shapes();
  const double below = now.X_EO ? HeldBelow(now, now.X_WE.q)
                                : shapes.Reach(Shapes::Part::kHand, false, now.X_WE.q, -Eigen::Vector3d::UnitZ());
  Surroundings around{.avoid = session_->config().avoid};
  for (const auto& object : session_->world().scene().objects()) {
    if (object.name == session_->config().target) continue;
    const Pose X_WO = session_->world().ObjectPose(object.name);
    around.hands.push_back(X_WO.p - Eigen::Vector3d(0, shapes.ahead_open(), 0));
    const double top = (X_WO * shapes.Centre(object.name)).z() + object.half_extent.maxCoeff();
    around.over = std::max(around.over, top + below + kOver);
  }
  return around;
}

std::vector<Eigen::Vector3d> Expert::AvoidedPlaces() const {
  std::vector<Eigen::Vector3d> places;
  for (const auto& name : session_->config().avoid) places.push_back(session_->world().ObjectPose(name).p);
  return places;
}

Verdict Expert::AvoidWhatMoved(const Piece& piece, int step, std::optional<Piece>& rest) {
  if (step % kWatchSteps != 0 || piece.avoided.empty()) return {};
  const auto now = AvoidedPlaces();
  double moved = 0;
  for (std::size_t i = 0; i < now.size(); ++i) moved = std::max(moved, (now[i] - piece.avoided[i]).norm());
  if (moved < kMoved) return {};
  const Stopwatch watch(session_->times().plan);
  const int i = piece.stage[step];
  UpdateChecker(stages_[i]);
  const Eigen::VectorXd q = session_->world().q();
  if (!planner_->FindBlockage(piece.motion, step, q)) return {};
  Pose goal = piece.motion.X_WE.back();
  if (i != piece.last) goal = stages_[i].goal(Now());
  const std::uint64_t seed = MixSeed({seed_, std::uint64_t(plans_++)}, "plan");
  const plan::Outcome outcome = planner_->Replan(piece.motion, step, q, goal, stages_[i], Around(Now()), seed);
  if (!outcome.planned())
    return Failed(AttemptOutcome::kPlanFailed, fmt::format("{}: planning anew: {}: {}", stages_[i].name,
                                                           plan::ToString(outcome.kind), outcome.reason));
  ++replans_;
  rest = Piece{.motion = outcome.motion, .goal = {goal.p}, .first = i, .last = i, .avoided = now};
  rest->stage.assign(static_cast<std::size_t>(outcome.motion.steps()), i);
  return {};
}

void Expert::UpdateChecker(const Stage& stage) {
  const sim::World& world = session_->world();
  const std::string& target = session_->config().target;
  for (const auto& object : world.scene().objects()) checker_->SetObject(object.name, world.ObjectPose(object.name));
  SetForStage(stage, target, X_EO_, *checker_);
}

Verdict Expert::PlanPiece(int first, Piece& piece) {
  const Stopwatch watch(session_->times().plan);
  const Verdict verdict = TryPiece(first, true, piece);
  if (verdict.ok() || stages_[first].clearance == 0) return verdict;
  // another way may arrive with the arm in another branch, from which the next stage can be done
  Piece other;
  if (!TryPiece(first, false, other).ok()) return verdict;
  piece = std::move(other);
  return {};
}

Verdict Expert::TryPiece(int first, bool by_field, Piece& piece) {
  Situation now = Now();
  Eigen::VectorXd q = session_->world().q();
  if (const auto q_reference = planner_->Solve(reference_, q)) q = *q_reference;
  piece.first = first;
  piece.avoided = AvoidedPlaces();
  for (int i = first;; ++i) {
    Stage stage = stages_[i];
    if (!by_field && stage.clearance > 0) {
      stage.margin = kAvoidMargin;
      stage.clearance = 0;
    }
    UpdateChecker(stage);
    Pose goal = stage.goal(now);
    const std::uint64_t seed = MixSeed({seed_, std::uint64_t(plans_++)}, "plan");
    PlannedStage planned = planner_->Plan(q, goal, stage, Around(now), seed);
    if (stage.nearer && !planned.planned()) {
      goal = stage.nearer(now);
      planned = planner_->Plan(q, goal, stage, Around(now), seed);
    }
    if (!planned.planned())
      return Failed(
          AttemptOutcome::kPlanFailed,
          fmt::format("{}: {}: {}", stage.name, plan::ToString(planned.outcome.kind), planned.outcome.reason));
    const plan::Motion& motion = planned.outcome.motion;
    int overlap = 0;
    if (i == first) {
      piece.motion = motion;
    } else {
      overlap = planner_->JoinIfFree(piece.motion, motion, stage.limits, q);
    }
    // The corner belongs half to each stage.
    if (!piece.stage.empty()) piece.stage.resize(piece.stage.size() - overlap / 2, i);
    piece.stage.resize(piece.motion.steps(), i);
    piece.goal.push_back(goal.p);
    planned_.push_back({{"stage", stage.name},
                        {"kind", plan::ToString(planned.outcome.kind)},
                        {"detour", planned.detour},
                        {"samples", planned.outcome.samples},
                        {"checks", planned.outcome.checks},
                        {"steps", motion.steps()},
                        {"blocked", planned.blocked}});
    piece.last = i;
    if (!stage.blends) return {};
    q = planned.q_end;
    now.X_WE = goal;
  }
}

Expert::Interruption Expert::DrawInterruption(const Piece& piece) {
  Interruption interruption;
  for (int i = piece.first; i <= piece.last; ++i) {
    const Stage& stage = stages_[i];
    if (push_drawn_[i] || !stage.disturbable) continue;
    push_drawn_[i] = true;
    if (!push_rng_.Bernoulli(randomization_.disturbance_probability)) continue;
    std::vector<int> steps;  // where it may begin
    for (int t = 0; t < piece.motion.steps(); ++t) {
      const double left = (piece.motion.X_WE[t].p - piece.goal[i - piece.first]).norm();
      if (piece.stage[t] == i && left > stage.calm) steps.push_back(t);
    }
    if (steps.empty()) continue;
    const int at = steps[push_rng_.Below(steps.size())];
    const Push push = DrawPush(randomization_, push_rng_);
    plan::Motion motion = PushMotion(piece.motion, at, push);
    UpdateChecker(stage);
    if (!stage.holds) checker_->Allow({});  // a push must not hit what the stage will touch
    const auto q = planner_->Solve(motion.X_WE.front(), session_->world().q());
    if (!q || !PushIsFree(motion, *q, planner_->kinematics(), *checker_)) continue;
    // One push a piece: a later stage keeps its chance for the piece that is planned afterwards.
    return {at, std::move(motion)};
  }
  return interruption;
}

Verdict Expert::PlayPiece(const Piece& piece, int& next_stage) {
  Interruption push;
  {
    const Stopwatch watch(session_->times().plan);
    push = DrawInterruption(piece);
  }
  const int end = push.at >= 0 ? push.at : piece.motion.steps();
  for (int t = 0; t < end; ++t) {
    std::optional<Piece> rest;
    Verdict verdict = AvoidWhatMoved(piece, t, rest);
    if (!verdict.ok()) return verdict;
    if (rest) return PlayPiece(*rest, next_stage);
    verdict = PlayStep(piece.stage[t], piece.motion.X_WE[t], piece.motion.V_WE[t], true);
    if (!verdict.ok()) return verdict;
  }
  if (push.at < 0) {
    next_stage = piece.last + 1;
    return Settle(piece.last, piece.motion.X_WE.back());
  }
  ++pushes_;
  const int stage = piece.stage[push.at];
  for (int t = 0; t < push.motion.steps(); ++t) {
    const Verdict verdict = PlayStep(stage, push.motion.X_WE[t], push.motion.V_WE[t], false);
    if (!verdict.ok()) return verdict;
  }
  next_stage = stage - stages_[stage].back_to;
  return {};
}

Verdict Expert::PlayStep(int stage, const Pose& X_WE, const Vector6& V_WE, bool supervise) {
  reference_ = X_WE;
  const Command command{{X_WE, stages_[stage].closed ? 1.0 : 0.0}, V_WE, stage, supervise};
  if (!session_->Step(command)) return Stopped(stage);
  return Check(stage);
}

Verdict Expert::Stopped(int stage) const {
  return Failed(session_->failure(), fmt::format("{}: {}", stages_[stage].name, session_->failure_reason()));
}

Verdict Expert::Check(int stage) const {
  if (!stages_[stage].holds || !X_EO_) return {};
  const Pose X_WO = session_->world().ObjectPose(session_->config().target);
  const double shift = ((session_->world().X_WE().inverse() * X_WO).p - X_EO_->p).norm();
  if (shift < kDropDistance) return {};
  return Failed(AttemptOutcome::kDropped, fmt::format("{}: {} shifted by {:.3f} m in the hand", stages_[stage].name,
                                                      session_->config().target, shift));
}

// Waits until the hand has caught up with the end of the motion.
Verdict Expert::Settle(int stage, const Pose& goal) {
  double error = 0;
  for (int t = 0; t <= kSettleSteps; ++t) {
    error = (session_->world().X_WE().p - goal.p).norm();
    if (error < kGoalTolerance) return {};
    const Verdict verdict = PlayStep(stage, goal, Vector6::Zero(), true);
    if (!verdict.ok()) return verdict;
  }
  return Failed(AttemptOutcome::kTimeout, fmt::format("{}: hand is {:.3f} m off its goal", stages_[stage].name, error));
}

Verdict Expert::PlayWait(int stage) {
  const Stage& wait = stages_[stage];
  for (int t = 0; t < wait.max_steps; ++t) {
    const bool done = !wait.done || wait.done(session_->world(), session_->config().target);
    if (t >= wait.min_steps && done) break;
    const Verdict verdict = PlayStep(stage, reference_, Vector6::Zero(), true);
    if (!verdict.ok()) return verdict;
  }
  return AfterWait(stage);
}

Verdict Expert::AfterWait(int stage) {
  const Stage& wait = stages_[stage];
  sim::World& world = session_->world();
  const std::string& target = session_->config().target;
  if (wait.done && !wait.done(world, target))
    return Failed(AttemptOutcome::kGraspMissed,
                  fmt::format("{}: {} is not between the fingers but touches {}", wait.name, target,
                              fmt::join(world.ContactsOf(target), ", ")));
  if (wait.name == "grasp") X_EO_ = world.X_WE().inverse() * world.ObjectPose(target);
  if (wait.name == "release") X_EO_.reset();
  return {};
}

Verdict Expert::FinalCheck() const {
  const auto& criterion = session_->criterion();
  const std::string& target = session_->config().target;
  const sim::World& world = session_->world();
  const std::string& task = session_->config().task.base;
  if (!criterion.success())
    return Failed(
        AttemptOutcome::kCriterionFailed,
        fmt::format("{}: progress {:.3f} m{}{}{}", task, criterion.progress(), criterion.lifted() ? ", lifted" : "",
                    criterion.turned() ? ", turned" : "", criterion.laid() ? ", laid" : ""));
  if ((task == "pick" || task == "rotate") && !world.Grasped(target))
    return Failed(AttemptOutcome::kDropped, fmt::format("hold: {} is not held", target));
  if (task == "put_down" && (!LiesDown(world.ObjectPose(target)) || world.Grasped(target)))
    return Failed(AttemptOutcome::kCriterionFailed, fmt::format("{} does not lie on the table", target));
  return {};
}

OrderedJson Expert::Statistics() const { return {{"planned", planned_}, {"pushes", pushes_}, {"replans", replans_}}; }

}  // namespace etude::task
