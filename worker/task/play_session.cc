// SPDX-License-Identifier: Apache-2.0
#include "worker/task/play_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "services/core/clock.h"
#include "services/core/config.h"
#include "services/spec/object_names.h"
#include "services/spec/task_roles.h"
#include "worker/plan/planner.h"
#include "worker/task/primitives/tuning.h"
#include "worker/task/rollout.h"
#include "worker/task/start_rule.h"

namespace etude::task {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr int kPlacedSettleSteps = 50;  // control steps after something was moved
constexpr double kParkedBehind = 6.0;   // m along y: behind every camera that looks at the table
constexpr double kParkedApart = 0.5;    // m
constexpr double kHomeWithin = 0.03;    // m and
constexpr double kHomeTurn = 0.10;      // rad from where the scene began
constexpr double kHandSpeed = 0.15;     // m/s
constexpr double kBackOff = 0.10;       // m along the hand, out of what it was round
constexpr int kOpenSteps = 40;          // control steps that the fingers get to open
constexpr double kGapBelow = 0.002;     // m between a held object and the table when it is let go
constexpr int kLooks = 16;              // along the way of what is nudged
constexpr double kOutOfReach = 2.0;     // m that nothing is lifted by
constexpr std::uint64_t kHomeSeed = 1;  // of the planner

double Blend(double s) { return s * s * (3 - 2 * s); }
double BlendRate(double s) { return 6 * s * (1 - s); }

// A task that is never done: what is said without a meaning is not judged.
TaskName NeverDone() {
  auto spec = std::make_shared<TaskSpec>();
  spec->name = "unjudged";
  spec->success.kind = "risen";
  spec->success.parameters["by"] = {.number = kOutOfReach, .unit = "m"};
  return {.base = spec->name, .avoid = "", .spec = std::move(spec)};
}

OrderedJson JsonOf(const Judge& judge, bool judged) {
  OrderedJson report = judge.Report();
  return {{"judged", judged},
          {"done", judge.done()},
          {"held", judge.held()},
          {"dwell", kDwell},
          {"words", judged ? judge.Words() : ""},
          {"touched", judge.touched()},
          {"success_latched", judged && judge.success_latched()},
          {"violations", std::move(report["violations"])},
          {"disturbed", std::move(report["disturbed_objects"])}};
}

Error InTheArm(const std::string& object, const std::string& body) {
  return {Code::kInvalidArgument, fmt::format("{} would be where the arm is ({})", object, body)};
}

std::vector<std::string> NamesOf(const std::vector<sim::ObjectInfo>& objects) {
  std::vector<std::string> names;
  for (const auto& object : objects) names.push_back(object.name);
  return names;
}

}  // namespace

PlaySession::PlaySession(const CampaignSpec& spec, const sim::RendererConfig& renderer)
    : spec_(spec), renderer_config_(sim::RendererFor(spec, renderer)) {
  spec_.rollout.pushes.count = 0;
  spec_.rollout.occlude = 0;
  spec_.rollout.record = false;
}

PlaySession::~PlaySession() = default;

Result<std::unique_ptr<PlaySession>> PlaySession::Open(const CampaignSpec& spec, std::uint64_t index,
                                                       const sim::RendererConfig& renderer) {
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  // sentences are obeyed as rollouts are, whatever the campaign is for
  CampaignSpec driven = spec;
  driven.mode = "rollout";
  driven.rollout.run = "play";
  driven.adaptive_sampling = {};
  driven.recheck = 0;
  ETUDE_RETURN_IF_ERROR(driven.Validate());
  for (const auto& name : spec.tasks) {
    ETUDE_ASSIGN_OR_RETURN(const TaskName task, ParseTask(name));
    ETUDE_RETURN_IF_ERROR(CheckPredicates(*task.spec, SceneNames(spec.objects)));
  }
  std::unique_ptr<PlaySession> session(new PlaySession(spec, renderer));
  ETUDE_RETURN_IF_ERROR(session->SetScene(index, {}));
  return session;
}

// ---- scenes ---------------------------------------------------------------------------------------

// A scene of its own is prepared beside the one that is there, which is given up only when nothing failed.
Status PlaySession::SetScene(std::uint64_t index, const std::vector<ObjectPlace>& places) {
  const EpisodePlan plan = PlanEpisode(spec_, index, 0);
  ETUDE_ASSIGN_OR_RETURN(auto made, EpisodeEnvironment::Open(plan.scene, renderer_config_));
  ETUDE_RETURN_IF_ERROR(Prepare(*made, plan, places));
  environment_ = std::move(made);
  plan_ = plan;
  places_ = places;
  Forget();
  return {};
}

// The same bits each time, and without `places` those from which an evaluation's rollout of the episode starts.
Status PlaySession::Prepare(EpisodeEnvironment& in, const EpisodePlan& plan,
                            const std::vector<ObjectPlace>& places) const {
  const SceneDraws draws = in.Prepare(plan, spec_.randomization);
  if (!draws.ok()) return Fail(Code::kNotFound, fmt::format("episode {} has no scene: {}", plan.index, draws.failure));
  if (places.empty()) return {};
  ETUDE_ASSIGN_OR_RETURN(const auto objects, Arranged(in, places));
  return Settle(in, objects);
}

void PlaySession::Forget() {
  home_ = environment_->world.q();
  hidden_.clear();
  slide_.reset();
  closed_ = false;
  steps_ = max_steps_ = 0;
  judged_ = OrderedJson::object();
  answer_ = {};
}

Result<std::vector<PlacedObject>> PlaySession::Arranged(const EpisodeEnvironment& in,
                                                        const std::vector<ObjectPlace>& places) const {
  std::vector<ObjectPlace> all = places;
  for (const auto& object : in.scene->objects())
    if (!Names(places, object.name)) all.push_back(PlaceOf(object.name, in.world.ObjectPose(object.name)));
  return PlaceUpright(in.scene->objects(), all);
}

Status PlaySession::Settle(EpisodeEnvironment& in, const std::vector<PlacedObject>& objects) const {
  const Eigen::VectorXd q = in.world.q();
  in.checker.ClearObjects();
  for (const auto& object : objects) in.checker.SetObject(object.name, object.X_WO);
  in.checker.SetGripper(0);
  if (const auto touched = in.checker.Check(q, kStartMargin)) return Fail(InTheArm(touched->body_b, touched->body_a));
  in.world.Reset();
  in.world.SetArm(q);
  SetObjects(in.world, objects);
  const Waypoint here{in.world.X_WE(), 0};
  for (int step = 0; step < kPlacedSettleSteps; ++step) in.world.Step(here, Vector6d::Zero());
  return CheckAtRest(in.world, objects);
}

Status PlaySession::Reset() {
  // what was put where the robot had made room is in the way of what stands there at the beginning
  if (!Prepare(*environment_, plan_, places_)) {
    places_.clear();
    ETUDE_RETURN_IF_ERROR(Prepare(*environment_, plan_, places_));
  }
  Forget();
  return {};
}

// ---- what a person moves --------------------------------------------------------------------------

Result<const sim::ObjectInfo*> PlaySession::Free(const std::string& name) const {
  const auto& objects = environment_->scene->objects();
  const auto object = std::ranges::find(objects, name, &sim::ObjectInfo::name);
  if (object == objects.end())
    return Fail(Code::kInvalidArgument, "object " + NotKnown(name.substr(0, 40), NamesOf(objects)));
  if (hidden(name)) return Fail(Code::kUnavailable, fmt::format("{} is hidden: show it first", name));
  if (slide_) return Fail(Code::kUnavailable, fmt::format("{} is being moved: wait for that", slide_->object));
  if (world().Grasped(name)) return Fail(Code::kUnavailable, fmt::format("{} is held by the robot", name));
  return &*object;
}

Status PlaySession::CheckFree(const sim::ObjectInfo& object, const ObjectPlace& at,
                              const std::vector<ObjectPlace>& moved) const {
  std::vector<ObjectPlace> places{at};
  for (const auto& other : environment_->scene->objects())
    if (other.name != object.name && !hidden(other.name) && !Names(moved, other.name))
      places.push_back(PlaceOf(other.name, world().ObjectPose(other.name)));
  const auto& all = environment_->scene->objects();
  // the others may lie as the robot left them: only this one has to find room
  for (std::size_t i = 1; i < places.size(); ++i) {
    const auto other = std::ranges::find(all, places[i].name, &sim::ObjectInfo::name);
    if (Overlap(object, at, *other, places[i]))
      return Fail(Code::kInvalidArgument, fmt::format("{} would be where {} is", object.name, other->name));
  }
  ETUDE_ASSIGN_OR_RETURN(const auto alone, PlaceUpright({object}, {at}));
  (void)alone;
  return {};
}

// Against what stays where it is, and the arm as it stands.
Result<std::vector<PlacedObject>> PlaySession::Replaced(const std::vector<ObjectPlace>& places) const {
  EpisodeEnvironment& in = *environment_;
  ETUDE_ASSIGN_OR_RETURN(auto placed, PlaceUpright(in.scene->objects(), places));
  in.checker.ClearObjects();
  in.checker.SetGripper(in.world.gripper());
  for (std::size_t i = 0; i < places.size(); ++i) {
    ETUDE_ASSIGN_OR_RETURN(const sim::ObjectInfo* const object, Free(places[i].name));
    ETUDE_RETURN_IF_ERROR(CheckFree(*object, places[i], places));
    in.checker.SetObject(placed[i].name, placed[i].X_WO);
  }
  for (const auto& near : in.checker.Distances(in.world.q(), kStartMargin))
    if (Names(places, near.body_b)) return Fail(InTheArm(near.body_b, near.body_a));
  return placed;
}

Status PlaySession::Place(const std::vector<ObjectPlace>& places) {
  if (doing_ != kAtRest) return Fail(Code::kUnavailable, "place objects: the policy drives: stop it first");
  ETUDE_ASSIGN_OR_RETURN(const auto placed, Replaced(places));
  sim::World& world = environment_->world;
  std::vector<PlacedObject> before;
  for (const auto& object : environment_->scene->objects())
    before.push_back({object.name, world.ObjectPose(object.name)});
  SetObjects(world, placed);
  Rest(kPlacedSettleSteps);
  if (const Status rests = CheckAtRest(world, placed); !rests) {
    SetObjects(world, before);
    return rests;
  }
  std::erase_if(places_, [&](const ObjectPlace& old) { return Names(places, old.name); });
  places_.insert(places_.end(), places.begin(), places.end());
  return {};
}

// Also while a policy drives: who asks the checker then says where the objects are and what may touch first.
Status PlaySession::CheckArm(const std::string& name, const Pose& X_WO) const {
  EpisodeEnvironment& in = *environment_;
  const collide::WithGripper measured(in.checker, in.world.gripper());
  in.checker.ClearObjects();
  in.checker.Allow({});
  in.checker.SetObject(name, X_WO);
  const auto near = in.checker.Distances(in.world.q(), kStartMargin);
  const auto touched = std::ranges::find(near, name, &collide::Proximity::body_b);
  return touched == near.end() ? Status() : Fail(InTheArm(name, touched->body_a));
}

Status PlaySession::Nudge(const std::string& name, double dx, double dy) {
  ETUDE_ASSIGN_OR_RETURN(const sim::ObjectInfo* const object, Free(name));
  const double length = std::hypot(dx, dy);
  if (!std::isfinite(length) || length > kMostNudge)
    return Fail(Code::kInvalidArgument,
                fmt::format("nudge {} by ({:.3f}, {:.3f}) m: at most {:.2f} m", name, dx, dy, kMostNudge));
  const Pose from = world().ObjectPose(name);
  Pose to = from;
  to.p += Eigen::Vector3d(dx, dy, 0);
  const auto on_the_way = [&](double share) { return Pose{from.p + share * (to.p - from.p), from.q}; };
  ETUDE_RETURN_IF_ERROR(CheckFree(*object, PlaceOf(name, to)));
  // it would take along what stands between; out of what it leans on it may go
  const bool stands_free = CheckFree(*object, PlaceOf(name, from)).has_value();
  for (int i = 1; i < kLooks && stands_free; ++i)
    ETUDE_RETURN_IF_ERROR(CheckFree(*object, PlaceOf(name, on_the_way(static_cast<double>(i) / kLooks))));
  for (const double share : {0.5, 1.0}) ETUDE_RETURN_IF_ERROR(CheckArm(name, on_the_way(share)));
  return Move({.object = name, .from = from, .to = to, .step = 0, .steps = kNudgeSteps});
}

Status PlaySession::Hide(const std::string& name) {
  ETUDE_ASSIGN_OR_RETURN(const sim::ObjectInfo* const object, Free(name));
  const Pose from = world().ObjectPose(name);
  const auto& objects = environment_->scene->objects();
  const auto number = static_cast<double>(object - objects.data());
  const Pose to{{kParkedApart * number, kParkedBehind, object->rest_height}, Eigen::Quaterniond::Identity()};
  hidden_[name] = from;
  return Move({.object = name, .from = to, .to = to, .step = 0, .steps = 1});
}

Status PlaySession::Show(const std::string& name) {
  const auto found = hidden_.find(name);
  if (found == hidden_.end()) return Fail(Code::kInvalidArgument, fmt::format("{:.40} is not hidden", name));
  const Pose to = found->second;
  const auto& objects = environment_->scene->objects();
  const auto object = std::ranges::find(objects, name, &sim::ObjectInfo::name);
  hidden_.erase(found);
  Status free;
  if (slide_) free = Fail(Code::kUnavailable, fmt::format("{} is being moved: wait for that", slide_->object));
  if (free) free = CheckFree(*object, PlaceOf(name, to));
  if (free) free = CheckArm(name, to);
  if (free) return Move({.object = name, .from = to, .to = to, .step = 0, .steps = 1});
  hidden_[name] = to;
  return free;
}

Status PlaySession::Move(Slide slide) {
  slide_ = std::move(slide);
  // while the arm comes home, or a policy drives, it goes on with their steps
  if (doing_ == kAtRest) Rest(slide_->steps + kPlacedSettleSteps);
  return {};
}

void PlaySession::GoOnSliding() {
  if (!slide_) return;
  Slide& slide = *slide_;
  const double s = static_cast<double>(++slide.step) / slide.steps;
  const double rate = BlendRate(s) * kControlRate / slide.steps;
  const Eigen::Vector3d by = slide.to.p - slide.from.p;
  const Pose X_WO{slide.from.p + Blend(s) * by, slide.from.q};
  if (running_)
    running_->PushObject(slide.object, X_WO, rate * by);  // the judge counts only what the robot does
  else
    environment_->world.Guide(slide.object, X_WO, rate * by);
  if (slide.step == slide.steps) slide_.reset();
}

void PlaySession::Rest(int steps) {
  sim::World& world = environment_->world;
  const Waypoint here{world.X_WE(), closed_ ? 1.0 : 0.0};
  for (int step = 0; step < steps; ++step) {
    GoOnSliding();
    world.Step(here, Vector6d::Zero());
  }
}

// ---- home -----------------------------------------------------------------------------------------

bool PlaySession::Follow(const std::vector<Waypoint>& targets, const std::vector<Vector6d>& V, const Hook& hook) {
  for (std::size_t i = 0; i < targets.size(); ++i) {
    if (hook && !hook()) return false;
    GoOnSliding();
    environment_->world.Step(targets[i], V[i]);
    closed_ = targets[i].gripper > 0.5;
  }
  return true;
}

bool PlaySession::Straight(const Eigen::Vector3d& by, bool closed, const Hook& hook) {
  const int steps = std::max(1, static_cast<int>(std::ceil(by.norm() / kHandSpeed * kControlRate)));
  const Pose from = world().X_WE();
  std::vector<Waypoint> targets;
  Vector6d V = Vector6d::Zero();
  V.head<3>() = by / steps * kControlRate;
  for (int step = 1; step <= steps; ++step)
    targets.push_back({{from.p + by * step / steps, from.q}, closed ? 1.0 : 0.0});
  return Follow(targets, std::vector<Vector6d>(targets.size(), V), hook);
}

bool PlaySession::IsHome() const {
  const Pose home = environment_->planner.kinematics().X_WE(home_);
  const Pose now = world().X_WE();
  return !closed_ && (now.p - home.p).norm() < kHomeWithin && AngleBetween(now.q, home.q) < kHomeTurn;
}

bool PlaySession::StandsOnAnother(const std::string& object) const {
  const double z = world().ObjectPose(object).p.z();
  return std::ranges::any_of(world().ContactsOf(object), [&](const std::string& body) {
    const auto& objects = environment_->scene->objects();
    return std::ranges::find(objects, body, &sim::ObjectInfo::name) != objects.end() &&
           world().ObjectPose(body).p.z() < z;
  });
}

// What is held is put down where it is, or onto what stands there, the fingers open and back off, then the arm is
// planned to where the scene began. Where no way is found the arm stays: policies may start from anywhere, if not as
// well.
bool PlaySession::GoHome(const Hook& hook) {
  if (closed_) {
    double below = 0;
    std::string held;
    for (const auto& object : environment_->scene->objects()) {
      if (!world().Grasped(object.name)) continue;
      const Pose X_WO = world().ObjectPose(object.name);
      below = X_WO.p.z() - environment_->shapes.HeightOnTable(object.name, X_WO.q) - kGapBelow;
      held = object.name;
    }
    bool stands = false;
    const Hook until_it_stands = [&] {
      stands = StandsOnAnother(held);
      return !stands && (!hook || hook());
    };
    if (below > 0 && !Straight({0, 0, -below}, true, until_it_stands) && !stands) return false;
    const Waypoint open{world().X_WE(), 0};
    if (!Follow(std::vector<Waypoint>(kOpenSteps, open), std::vector<Vector6d>(kOpenSteps, Vector6d::Zero()), hook))
      return false;
    // x of E points back along the hand
    if (!Straight(kBackOff * (world().X_WE().q * Eigen::Vector3d::UnitX()), false, hook)) return false;
  }
  collide::Checker& checker = environment_->checker;
  checker.ClearObjects();
  for (const auto& object : environment_->scene->objects())
    if (!hidden(object.name)) checker.SetObject(object.name, world().ObjectPose(object.name));
  checker.SetGripper(0);
  plan::Planner planner(environment_->scene);
  plan::Request request;
  request.q_start = world().q();
  request.q_goal = home_;
  request.X_WE_goal = environment_->planner.kinematics().X_WE(home_);
  request.limits.joint = kStages.planned_speed * environment_->scene->arm().planned_speed.minCoeff();
  const plan::Outcome outcome = planner.Plan(request, checker, kHomeSeed);
  if (!outcome.planned()) return true;
  std::vector<Waypoint> targets;
  for (const Pose& X_WE : outcome.motion.X_WE) targets.push_back({X_WE, 0});
  return Follow(targets, outcome.motion.V_WE, hook);
}

// ---- sentences ------------------------------------------------------------------------------------

Result<EpisodePlan> PlaySession::PlanOf(const Sentence& sentence) const {
  EpisodePlan plan = plan_;
  plan.sentence = sentence.text;
  const auto& objects = environment_->scene->objects();
  if (sentence.text.empty()) return Fail(Code::kInvalidArgument, "say: the sentence is empty");
  if (sentence.max_steps > kMostSentenceSteps)
    return Fail(Code::kInvalidArgument,
                fmt::format("say: max_steps {}: at most {}", sentence.max_steps, kMostSentenceSteps));
  if (!sentence.judged()) {
    plan.task = NeverDone();
    plan.target = objects.front().name;
    plan.reference.clear();
    plan.avoid.clear();
    plan.distractors.clear();
    return plan;
  }
  ETUDE_ASSIGN_OR_RETURN(plan.task, ParseTask(sentence.task));
  ETUDE_RETURN_IF_ERROR(CheckPredicates(*plan.task.spec, SceneNames(spec_.objects)));
  const auto check = [&](const std::string& name) -> Status {
    if (std::ranges::find(objects, name, &sim::ObjectInfo::name) == objects.end())
      return Fail(Code::kInvalidArgument, "say: on the table " + NotKnown(name.substr(0, 40), NamesOf(objects)));
    if (hidden(name)) return Fail(Code::kInvalidArgument, fmt::format("say: {} is hidden: show it first", name));
    return {};
  };
  ETUDE_RETURN_IF_ERROR(check(sentence.target));
  plan.target = sentence.target;
  plan.reference = plan.task.relation() ? sentence.reference : "";
  if (plan.task.relation()) ETUDE_RETURN_IF_ERROR(check(plan.reference));
  if (plan.reference == plan.target)
    return Fail(Code::kInvalidArgument, fmt::format("say: {} cannot be put beside itself", plan.target));
  if (plan.has_obstacle()) ETUDE_RETURN_IF_ERROR(check(kObstacleObject));
  plan.avoid = AvoidedObjects(plan.task, plan.target, plan.reference, plan.scene.objects);
  // whom a person wants taken is no longer there to be left alone
  std::erase(plan.distractors, plan.target);
  std::erase(plan.distractors, plan.reference);
  return plan;
}

Status PlaySession::Check(const Sentence& sentence) const {
  if (const auto plan = PlanOf(sentence); !plan) return Fail(plan.error());
  return {};
}

Result<Verdict> PlaySession::Say(const Sentence& sentence, const policy::AskFunction& ask, const Hook& hook) {
  ETUDE_ASSIGN_OR_RETURN(const EpisodePlan plan, PlanOf(sentence));
  steps_ = 0;
  max_steps_ = sentence.max_steps > 0 ? sentence.max_steps : StepLimitOf(spec_.rollout, plan_.scene.robot);
  judged_ = OrderedJson::object();
  answer_ = {};
  if (sentence.home && !IsHome()) {
    doing_ = "homing";
    const bool home = GoHome(hook);
    if (!home) {
      doing_ = kAtRest;
      Rest(kPlacedSettleSteps);  // what slides arrives
      return Verdict{AttemptOutcome::kStopped, "stopped on the way home"};
    }
  }
  doing_ = "driving";
  auto verdict = Drive(sentence, plan, ask, hook);
  doing_ = kAtRest;
  Rest(kPlacedSettleSteps);  // what slides arrives
  return verdict;
}

Result<Verdict> PlaySession::Drive(const Sentence& sentence, const EpisodePlan& plan, const policy::AskFunction& ask,
                                   const Hook& hook) {
  EpisodeEnvironment& in = *environment_;
  RecordConfig record{.image_stride = spec_.image_stride, .record_frames = false, .max_steps = max_steps_};
  record.go_on = [&] {
    const bool on = !hook || hook();
    GoOnSliding();
    return on;
  };
  ETUDE_ASSIGN_OR_RETURN(EpisodeRunner runner,
                         EpisodeRunner::Open({&in.world, &in.renderer, &in.shapes, &in.checker}, plan, record));
  running_ = &runner;
  const bool judged = sentence.judged();
  RolloutSpec driven = spec_.rollout;
  driven.max_steps = max_steps_;  // the policy is asked to the sentence's end
  task::Rollout rollout(&runner, &in.checker, in.scene, driven, sentence.text);
  const auto verdict = rollout.Run(
      [&](const policy::Question& question) -> Result<policy::Answer> {
        const etude::Stopwatch watch;
        auto answer = ask(question);
        policy_ms_ = 1e3 * watch.Seconds();
        if (answer) answer_ = *answer;
        return answer;
      },
      closed_);
  running_ = nullptr;
  steps_ = runner.steps();
  judged_ = JsonOf(runner.judge(), judged);
  const Track& commands = runner.episode().actions_abs;
  if (steps_ > 0) closed_ = FromVector(commands.row(steps_ - 1).data()).gripper > 0.5;
  if (!verdict) return Verdict{AttemptOutcome::kPolicyError, verdict.error().message};
  return *verdict;
}

// ---- what is to be seen ---------------------------------------------------------------------------

std::span<const std::uint8_t> PlaySession::Picture() {
  const Camera& camera = environment_->renderer.camera();
  picture_.resize(static_cast<std::size_t>(camera.width) * camera.height * 3);
  environment_->renderer.Render(environment_->world, picture_);
  return picture_;
}

int PlaySession::step() const { return running_ ? running_->steps() : steps_; }

OrderedJson PlaySession::JudgeJson() const {
  if (running_) return JsonOf(running_->judge(), running_->plan().task.base != NeverDone().base);
  return judged_;
}

OrderedJson PlaySession::SceneJson() const {
  const Camera& seen = camera();
  OrderedJson objects = OrderedJson::array();
  for (const auto& object : environment_->scene->objects()) {
    const Pose X_WO = hidden(object.name) ? hidden_.at(object.name) : world().ObjectPose(object.name);
    objects.push_back({{"name", object.name},
                       {"x", X_WO.p.x()},
                       {"y", X_WO.p.y()},
                       {"z", X_WO.p.z()},
                       {"yaw", YawOf(X_WO)},
                       {"half_extent", {object.half_extent.x(), object.half_extent.y(), object.half_extent.z()}},
                       {"hidden", hidden(object.name)}});
  }
  const Eigen::Quaterniond& q = seen.X_WC.q;
  return {{"robot", plan_.scene.robot},
          {"index", plan_.index},
          {"seed", std::to_string(plan_.seed)},
          {"camera",
           {{"width", seen.width},
            {"height", seen.height},
            {"fovy", seen.fovy},
            {"position", {seen.X_WC.p.x(), seen.X_WC.p.y(), seen.X_WC.p.z()}},
            {"quaternion", {q.w(), q.x(), q.y(), q.z()}}}},
          {"objects", std::move(objects)},
          {"table_half_m", kTableHalf}};
}

}  // namespace etude::task
