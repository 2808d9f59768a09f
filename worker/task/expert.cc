// SPDX-License-Identifier: Apache-2.0
#include "worker/task/expert.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "worker/plan/timer.h"
#include "worker/task/feasibility_check.h"
#include "worker/task/primitives/tuning.h"
#include "worker/task/task_stages.h"

namespace etude::task {
namespace {

constexpr double kDropDistance = 0.035;   // m that a held object may shift in the hand
constexpr double kOver = 0.03;            // m above everything on a way over the objects
constexpr int kWatchSteps = 10;           // steps between two looks at what has to be avoided
constexpr double kAvoidMargin = 0.02;     // m kept from everything where the field does not lead on
constexpr double kMoved = 0.005;          // m that it may move before that counts
constexpr double kGoalTolerance = 0.015;  // m between hand and goal when a stage counts as done
constexpr int kSettleSteps = 40;          // at most, to come within it
constexpr double kFingersThere = 0.1;     // of the gripper's way: so near to where it is wanted counts as there
constexpr double kFingerMargin = 0.01;    // m that fingers which still close keep from everything
constexpr int kFingerSteps = 100;         // that they are waited for, at most
constexpr int kFingerLook = 5;            // steps between two looks at the way
constexpr int kMostDwell = 2 * kDwell;    // steps that the last command is held, at most

Verdict Failed(AttemptOutcome outcome, std::string reason) { return {outcome, std::move(reason)}; }

// Of a stage that was not begun: the last step is of another one.
Verdict NotPlanned(const Stage& stage, std::string_view what, const plan::Outcome& outcome) {
  return {AttemptOutcome::kPlanFailed,
          fmt::format("{}: {}{}: {}", stage.name, what, plan::ToString(outcome.kind), outcome.reason), stage.name};
}

}  // namespace

Expert::Expert(EpisodeRunner* runner, StagePlanner* planner, collide::Checker* checker,
               const RandomizationSpec& randomization)
    : runner_(runner),
      planner_(planner),
      checker_(checker),
      randomization_(randomization),
      push_rng_(runner->plan().seeds.disturbance),
      stages_(StagesOf(runner->plan().task, runner->shapes(), runner->plan().clearance)),
      push_drawn_(stages_.size(), false),
      reference_(runner->world().X_WE()) {
  for (const auto& stage : stages_) runner_->episode().stage_names.push_back(stage.name);
}

Verdict Expert::Run() {
  int stage = 0;
  while (stage < static_cast<int>(stages_.size())) {
    Verdict verdict;
    if (stages_[stage].moves()) {
      MotionSegment segment;
      verdict = PlanSegment(stage, segment);
      if (verdict.ok()) verdict = PlaySegment(segment, stage);
    } else {
      verdict = PlayWait(stage++);
    }
    if (!verdict.ok()) return verdict;
  }
  return Dwell();
}

StageContext Expert::Now() const {
  const std::string& target = runner_->plan().target;
  const std::string& reference = runner_->plan().reference;
  StageContext now{.shapes = &runner_->shapes(),
                   .target = target,
                   .reference = reference,
                   .X_WO = runner_->world().ObjectPose(target),
                   .X_WE = reference_,
                   .X_EO = X_EO_};
  if (!reference.empty()) now.X_WR = runner_->world().ObjectPose(reference);
  return now;
}

Surroundings Expert::Around(const StageContext& now) const {
  const SceneGeometry& shapes = runner_->shapes();
  const double below = now.X_EO
                           ? HeldBelow(now, now.X_WE.q)
                           : shapes.Reach(SceneGeometry::Part::kHand, false, now.X_WE.q, -Eigen::Vector3d::UnitZ());
  Surroundings around{.avoid = runner_->plan().avoid};
  for (const auto& object : runner_->world().scene().objects()) {
    if (object.name == runner_->plan().target) continue;
    const Pose X_WO = runner_->world().ObjectPose(object.name);
    around.hands.push_back(X_WO.p - Eigen::Vector3d(0, shapes.ahead_open(), 0));
    const double top = (X_WO * shapes.Centre(object.name)).z() + object.half_extent.maxCoeff();
    around.over = std::max(around.over, top + below + kOver);
  }
  return around;
}

std::vector<Eigen::Vector3d> Expert::AvoidedPlaces() const {
  std::vector<Eigen::Vector3d> places;
  for (const auto& name : runner_->plan().avoid) places.push_back(runner_->world().ObjectPose(name).p);
  return places;
}

Verdict Expert::AvoidWhatMoved(const MotionSegment& segment, int step, std::optional<MotionSegment>& rest) {
  if (step % kWatchSteps != 0 || segment.avoided.empty()) return {};
  const auto now = AvoidedPlaces();
  double moved = 0;
  for (std::size_t i = 0; i < now.size(); ++i) moved = std::max(moved, (now[i] - segment.avoided[i]).norm());
  if (moved < kMoved) return {};
  const plan::Timer watch(runner_->times().plan);
  const int i = segment.stage[step];
  UpdateChecker(stages_[i]);
  const Eigen::VectorXd q = runner_->world().q();
  const auto blockage = planner_->FindBlockage(segment.motion, step, q);
  if (!blockage) return {};
  Pose goal = segment.motion.X_WE.back();
  if (i != segment.last) goal = stages_[i].goal(Now());
  const std::uint64_t seed = NextPlanSeed();
  const PlannedStage planned{
      .outcome = planner_->Replan(segment.motion, step, q, goal, stages_[i], Around(Now()), seed),
      .blocked = blockage->reason};
  const plan::Outcome& outcome = planned.outcome;
  if (!outcome.planned()) return NotPlanned(stages_[i], "planning anew: ", outcome);
  ++replans_;
  rest = MotionSegment{.motion = outcome.motion, .goal = {goal.p}, .first = i, .last = i, .avoided = now};
  rest->planned.push_back(PlannedJson(i, planned));
  rest->stage.assign(static_cast<std::size_t>(outcome.motion.steps()), i);
  return {};
}

std::uint64_t Expert::NextPlanSeed() {
  return MixSeed({runner_->plan().seeds.planning, std::uint64_t(plans_++)}, "motion");
}

OrderedJson Expert::PlannedJson(int stage, const PlannedStage& planned) const {
  return {{"stage", stages_[stage].name},
          {"way", planned.way()},
          {"samples", planned.outcome.samples},
          {"checks", planned.outcome.checks},
          {"steps", planned.outcome.motion.steps()},
          {"blocked", planned.blocked}};
}

// Plans that were thrown away, or of stages that a push keeps from being begun, are not how stages were done.
void Expert::KeepPlanned(const MotionSegment& segment, int last) {
  for (int i = segment.first; i <= last; ++i) planned_.push_back(segment.planned[i - segment.first]);
}

void Expert::KeepMotion(const plan::Motion& motion, int first, int last, bool disturbance) {
  if (!motions_) return;
  PlayedMotion played{.step = runner_->steps(), .stages = {}, .disturbance = disturbance, .motion = motion};
  for (int i = first; i <= last; ++i) played.stages.push_back(stages_[i].name);
  motions_->push_back(std::move(played));
}

void Expert::UpdateChecker(const Stage& stage) {
  const sim::World& world = runner_->world();
  const std::string& target = runner_->plan().target;
  for (const auto& object : world.scene().objects()) checker_->SetObject(object.name, world.ObjectPose(object.name));
  SetForStage(stage, target, X_EO_, *checker_);
}

Verdict Expert::PlanSegment(int first, MotionSegment& segment) {
  const plan::Timer watch(runner_->times().plan);
  Verdict verdict = TrySegment(first, true, segment);
  if (!verdict.ok() && stages_[first].clearance > 0) {
    // another way may arrive with the arm in another branch, from which the next stage can be done
    ++abandoned_;
    MotionSegment other;
    if (TrySegment(first, false, other).ok()) {
      segment = std::move(other);
      verdict = {};
    }
  }
  return verdict;
}

Verdict Expert::TrySegment(int first, bool by_field, MotionSegment& segment) {
  StageContext now = Now();
  Eigen::VectorXd q = runner_->world().q();
  if (const auto q_reference = planner_->Solve(reference_, q)) q = *q_reference;
  segment.first = first;
  segment.avoided = AvoidedPlaces();
  for (int i = first;; ++i) {
    Stage stage = stages_[i];
    if (!by_field && stage.clearance > 0) {
      stage.margin = kAvoidMargin;
      stage.clearance = 0;
    }
    UpdateChecker(stage);
    Pose goal = stage.goal(now);
    const std::uint64_t seed = NextPlanSeed();
    PlannedStage planned = planner_->Plan(q, goal, stage, Around(now), seed);
    if (stage.nearer && !planned.planned()) {
      goal = stage.nearer(now);
      planned = planner_->Plan(q, goal, stage, Around(now), seed);
    }
    if (!planned.planned()) return NotPlanned(stage, "", planned.outcome);
    const plan::Motion& motion = planned.outcome.motion;
    int overlap = 0;
    if (i == first) {
      segment.motion = motion;
    } else {
      overlap = planner_->JoinIfFree(segment.motion, motion, stage.limits, q);
    }
    // The corner belongs half to each stage.
    if (!segment.stage.empty()) segment.stage.resize(segment.stage.size() - overlap / 2, i);
    segment.stage.resize(segment.motion.steps(), i);
    segment.goal.push_back(goal.p);
    segment.planned.push_back(PlannedJson(i, planned));
    segment.last = i;
    if (!stage.blends) return {};
    q = planned.q_end;
    now.X_WE = goal;
  }
}

Expert::Interruption Expert::DrawInterruption(const MotionSegment& segment) {
  Interruption interruption;
  for (int i = segment.first; i <= segment.last; ++i) {
    const Stage& stage = stages_[i];
    if (push_drawn_[i] || !stage.disturbable) continue;
    push_drawn_[i] = true;
    if (!push_rng_.Bernoulli(randomization_.disturbance_probability)) continue;
    std::vector<int> steps;  // where it may begin
    for (int t = 0; t < segment.motion.steps(); ++t) {
      const double left = (segment.motion.X_WE[t].p - segment.goal[i - segment.first]).norm();
      if (segment.stage[t] == i && left > stage.calm) steps.push_back(t);
    }
    if (steps.empty()) continue;
    const int at = steps[push_rng_.Below(steps.size())];
    auto motion = FeasiblePush(segment.motion, at, stage);
    // One push a segment: a later stage keeps its chance for the segment that is planned afterwards.
    if (motion) return {at, std::move(*motion)};
  }
  return interruption;
}

std::optional<plan::Motion> Expert::FeasiblePush(const plan::Motion& path, int at, const Stage& stage) {
  constexpr int kSlowest = 4;  // times as long as drawn, for joints that are slow
  Push push = DrawPush(randomization_, push_rng_);
  // five joints turn a hand that points straight down about the vertical alone
  if (!runner_->world().scene().arm().turns_any_way()) push.rotation.head<2>().setZero();
  const int drawn_steps = push.steps;
  UpdateChecker(stage);
  if (!stage.holds) checker_->Allow({});  // a push must not hit what the stage will touch
  const Eigen::VectorXd joint_speed = kStages.planned_speed * runner_->world().scene().arm().planned_speed;
  for (int slower = 1; slower <= kSlowest; ++slower) {
    push.steps = slower * drawn_steps;
    plan::Motion motion = PushMotion(path, at, push);
    const auto q = planner_->Solve(motion.X_WE.front(), runner_->world().q());
    if (!q) return std::nullopt;
    const PushVerdict verdict = JudgePush(motion, *q, joint_speed, planner_->kinematics(), *checker_);
    if (verdict == PushVerdict::kFree) return motion;
    if (verdict == PushVerdict::kBlocked) return std::nullopt;
  }
  return std::nullopt;
}

// A motion is planned with the fingers as its stage wants them, and open ones sweep more while they still close.
bool Expert::FingersInTheWay(const MotionSegment& segment) {
  const Stage& stage = stages_[segment.first];
  const double now = runner_->world().gripper();
  if (!stage.closed || stage.holds || now > 1 - kFingersThere) return false;
  const plan::Timer watch(runner_->times().plan);
  UpdateChecker(stage);
  Eigen::VectorXd q = runner_->world().q();
  for (int t = 0; t < std::min(kFingerSteps, segment.motion.steps()); t += kFingerLook) {
    if (const auto solved = planner_->Solve(segment.motion.X_WE[t], q)) q = *solved;
    for (const double gripper : {now, 0.5 * (now + 1)}) {
      checker_->SetGripper(gripper);
      if (checker_->Check(q, kFingerMargin)) return true;
    }
  }
  return false;
}

Verdict Expert::CloseFirst(const MotionSegment& segment) {
  if (!FingersInTheWay(segment)) return {};
  for (int t = 0; t < kFingerSteps && runner_->world().gripper() < 1 - kFingersThere; ++t) {
    const Verdict verdict = PlayStep(segment.first, reference_, Vector6::Zero(), true);
    if (!verdict.ok()) return verdict;
  }
  return {};
}

Verdict Expert::PlaySegment(const MotionSegment& segment, int& next_stage) {
  if (const Verdict verdict = CloseFirst(segment); !verdict.ok()) return verdict;
  Interruption push;
  {
    const plan::Timer watch(runner_->times().plan);
    push = DrawInterruption(segment);
  }
  const int end = push.at >= 0 ? push.at : segment.motion.steps();
  KeepPlanned(segment, push.at >= 0 ? segment.stage[push.at] : segment.last);
  KeepMotion(segment.motion, segment.first, segment.last, false);
  for (int t = 0; t < end; ++t) {
    std::optional<MotionSegment> rest;
    Verdict verdict = AvoidWhatMoved(segment, t, rest);
    if (!verdict.ok()) return verdict;
    if (rest) return PlaySegment(*rest, next_stage);
    verdict = PlayStep(segment.stage[t], segment.motion.X_WE[t], segment.motion.V_WE[t], true);
    if (!verdict.ok()) return verdict;
  }
  if (push.at < 0) {
    next_stage = segment.last + 1;
    return Settle(segment.last, segment.motion.X_WE.back());
  }
  ++pushes_;
  const int stage = segment.stage[push.at];
  KeepMotion(push.motion, stage, stage, true);
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
  if (!runner_->Step(command)) return Stopped(stage);
  return Check(stage);
}

Verdict Expert::Stopped(int stage) const {
  return Failed(runner_->failure(), fmt::format("{}: {}", stages_[stage].name, runner_->failure_reason()));
}

Verdict Expert::Check(int stage) const {
  if (const Verdict verdict = VerdictOnViolations(runner_->judge()); !verdict.ok())
    return Failed(verdict.outcome, fmt::format("{}: {}", stages_[stage].name, verdict.reason));
  if (!stages_[stage].holds || !X_EO_) return {};
  const Pose X_WO = runner_->world().ObjectPose(runner_->plan().target);
  const double shift = ((runner_->world().X_WE().inverse() * X_WO).p - X_EO_->p).norm();
  if (shift < kDropDistance) return {};
  return Failed(AttemptOutcome::kDropped, fmt::format("{}: {} shifted by {:.3f} m in the hand", stages_[stage].name,
                                                      runner_->plan().target, shift));
}

// Waits until the hand has caught up with the end of the motion.
Verdict Expert::Settle(int stage, const Pose& goal) {
  double error = 0;
  for (int t = 0; t <= kSettleSteps; ++t) {
    error = (runner_->world().X_WE().p - goal.p).norm();
    if (error < kGoalTolerance) return {};
    const Verdict verdict = PlayStep(stage, goal, Vector6::Zero(), true);
    if (!verdict.ok()) return verdict;
  }
  if (error < stages_[stage].held_back) return {};
  return Failed(AttemptOutcome::kTimeout, fmt::format("{}: hand is {:.3f} m off its goal", stages_[stage].name, error));
}

Verdict Expert::PlayWait(int stage) {
  const Stage& wait = stages_[stage];
  // the fingers hear of it that much later
  const int most = wait.max_steps + runner_->world().scene().control_delay();
  for (int t = 0; t < most; ++t) {
    const bool done = !wait.done || wait.done(runner_->world(), runner_->plan().target);
    if (t >= wait.min_steps && done) break;
    const Verdict verdict = PlayStep(stage, reference_, Vector6::Zero(), true);
    if (!verdict.ok()) return verdict;
  }
  return AfterWait(stage);
}

Verdict Expert::AfterWait(int stage) {
  const Stage& wait = stages_[stage];
  sim::World& world = runner_->world();
  const std::string& target = runner_->plan().target;
  if (wait.done && !wait.done(world, target))
    return Failed(AttemptOutcome::kGraspMissed,
                  fmt::format("{}: {} is not between the fingers but touches {}", wait.name, target,
                              fmt::join(world.ContactsOf(target), ", ")));
  if (wait.effect == Stage::Effect::kGrasps) X_EO_ = world.X_WE().inverse() * world.ObjectPose(target);
  if (wait.effect == Stage::Effect::kReleases) X_EO_.reset();
  return {};
}

Verdict Expert::Dwell() {
  const int last = static_cast<int>(stages_.size()) - 1;
  for (int t = 0; runner_->judge().held() < kDwell; ++t) {
    if (t == kMostDwell)
      return Failed(AttemptOutcome::kCriterionFailed,
                    fmt::format("{}: {}", runner_->plan().task.base, runner_->judge().Words()));
    const Verdict verdict = PlayStep(last, reference_, Vector6::Zero(), true);
    if (!verdict.ok()) return verdict;
  }
  return {};
}

OrderedJson Expert::Statistics() const {
  return {{"planned", planned_}, {"abandoned", abandoned_}, {"pushes", pushes_}, {"replans", replans_}};
}

}  // namespace etude::task
