// SPDX-License-Identifier: Apache-2.0
#include "worker/task/play_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "services/core/clock.h"
#include "services/core/config.h"
#include "services/spec/object_names.h"
#include "services/spec/task_roles.h"
#include "worker/task/predicates/task_predicates.h"
#include "worker/task/rollout.h"

namespace etude::task {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr double kOutOfReach = 2.0;  // m that nothing is lifted by

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
    if (!IsAmong(places, object.name)) all.push_back(PlaceOf(object.name, in.world.ObjectPose(object.name)));
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
