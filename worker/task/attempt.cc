// SPDX-License-Identifier: Apache-2.0
#include "worker/task/attempt.h"

#include <fmt/format.h>

#include <algorithm>
#include <list>
#include <optional>

#include "services/core/check.h"
#include "services/language/grammar.h"
#include "services/spec/content_version.h"
#include "services/spec/object_names.h"
#include "services/spec/robot_names.h"
#include "worker/plan/timer.h"
#include "worker/sim/robot_file.h"
#include "worker/task/episode_environment.h"
#include "worker/task/expert.h"
#include "worker/task/occluder.h"
#include "worker/task/predicates/task_predicates.h"
#include "worker/task/rollout.h"

namespace etude::task {
namespace {

constexpr int kExpertMaxSteps = 2500;
constexpr std::size_t kKeptScenes = 6;  // compiled scenes kept for later episodes

/// What turns an object over is not for an arm that cannot turn its hand over.
Status CheckTurns(const CampaignSpec& spec, const TaskName& task) {
  if (!task.spec->Has(TurnSpec::kName)) return {};
  for (const std::string& robot : spec.robots) {
    ETUDE_ASSIGN_OR_RETURN(const Path yaml, FindRobot(robot));
    ETUDE_ASSIGN_OR_RETURN(const sim::LoadedRobot loaded, sim::LoadRobot(yaml));
    if (loaded.model.joints.size() < sim::kJointsOfAnyPose)
      return Fail(Code::kInvalidArgument,
                  fmt::format("'{}' turns an object over, which {} joints of '{}' cannot: leave out one of the two",
                              task.text(), loaded.model.joints.size(), robot));
  }
  return {};
}

/// What a task's predicates name must stand in each scene: an attempt without it could only fail.
Status CheckNamedObjects(const CampaignSpec& spec, const TaskName& task) {
  const auto own = SceneNames(spec.objects);
  const bool all = spec.objects_per_scene == 0 || spec.objects_per_scene == static_cast<int>(spec.objects.size());
  // the rule is asked before the ball is there: no start would ever be found
  if (const auto& rule = task.spec->start.not_already;
      rule && task.avoid == "obstacle" && std::ranges::count(NamedObjects(*rule, own), kObstacleObject) > 0)
    return Fail(Code::kInvalidArgument,
                fmt::format("task '{}': start.not_already speaks of the {}, which is placed after the objects",
                            task.text(), kObstacleObject));
  for (const std::string& object : NamedObjects(*task.spec, own)) {
    if (object == kObstacleObject && task.avoid == "obstacle") continue;
    const bool listed = std::ranges::count(own, object) > 0;
    if (listed && all) continue;
    return Fail(
        Code::kInvalidArgument,
        fmt::format("task '{}' speaks of '{}', {}", task.text(), object,
                    listed ? "which objects_per_scene leaves out of some scenes: set it to 0, or use a reference"
                           : "which is not among the campaign's objects: add it"));
  }
  return {};
}

}  // namespace

struct AttemptRunner::Impl {
  /// The environment of a scene: made, or one of those made last.
  Result<EpisodeEnvironment*> EnvironmentOf(const SceneSpec& scene);
  std::string DrawInstruction(const EpisodePlan& plan) const;
  /// Fills in identity and meaning and hands the episode over.
  void Finish(EpisodeRunner& runner, const Verdict& verdict, const std::string& instruction,
              AttemptResult& result) const;

  CampaignSpec spec;
  std::string spec_sha256;
  sim::RendererConfig renderer;
  language::Grammar grammar;
  struct Kept {
    SceneSpec scene;
    std::unique_ptr<EpisodeEnvironment> environment;
  };
  std::list<Kept> kept;  ///< the one used last first
  std::function<void(std::string_view stage, int step)> progress;

  /// Progress before there is a stage: a start in which the task can be done may be a long search.
  std::function<void(int start)> Drawing() const {
    if (!progress) return nullptr;
    return [this](int start) { progress("start", start); };
  }
};

Result<EpisodeEnvironment*> AttemptRunner::Impl::EnvironmentOf(const SceneSpec& scene) {
  auto it = std::find_if(kept.begin(), kept.end(), [&](const Kept& one) { return one.scene == scene; });
  if (it == kept.end()) {
    ETUDE_ASSIGN_OR_RETURN(auto environment, EpisodeEnvironment::Open(scene, renderer));
    if (kept.size() >= kKeptScenes) kept.pop_back();
    it = kept.insert(kept.begin(), {scene, std::move(environment)});
  }
  kept.splice(kept.begin(), kept, it);
  return it->environment.get();
}

std::string AttemptRunner::Impl::DrawInstruction(const EpisodePlan& plan) const {
  if (!plan.sentence.empty()) return plan.sentence;
  Rng rng(plan.seeds.instruction);
  return grammar.Sample(language::CommandFor(plan.task, plan.target, plan.reference), language::Style::kTemplate, rng);
}

void AttemptRunner::Impl::Finish(EpisodeRunner& runner, const Verdict& verdict, const std::string& instruction,
                                 AttemptResult& result) const {
  const EpisodePlan& plan = runner.plan();
  const double deflated = runner.times().deflate;
  Episode episode = runner.TakeEpisode();
  result.deflate_s += runner.times().deflate - deflated;
  episode.campaign = spec.name;
  episode.index = plan.index;
  episode.attempt = plan.attempt;
  episode.seed = plan.seed;
  episode.spec_sha256 = spec_sha256;
  episode.scene_sha256 = runner.world().scene().sha256();
  episode.version = std::to_string(kContentVersion);
  episode.robot = plan.scene.robot;
  episode.instruction = instruction;
  episode.success = verdict.ok();
  episode.outcome = ToString(verdict.outcome);
  episode.details.update(runner.judge().Report());
  episode.details["scene"] = result.scene;
  if (plan.has_obstacle()) episode.details["in_the_way"] = plan.obstacle == ObstaclePlace::kInTheWay;
  if (plan.world != EpisodeWorld{}) episode.details["world"] = ToJson(plan.world);
  if (!plan.weights_sha256.empty()) episode.details["sampling"] = SamplingDetails(plan);
  result.episode = std::move(episode);
}

Result<AttemptRunner> AttemptRunner::Open(const CampaignSpec& spec, const sim::RendererConfig& renderer) {
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  ETUDE_ASSIGN_OR_RETURN(auto grammar, language::Grammar::LoadFor(SceneNames(spec.objects), spec.tasks));
  for (const auto& name : spec.tasks) {
    ETUDE_ASSIGN_OR_RETURN(const TaskName task, ParseTask(name));
    ETUDE_RETURN_IF_ERROR(CheckPredicates(*task.spec, SceneNames(spec.objects)));
    ETUDE_RETURN_IF_ERROR(CheckNamedObjects(spec, task));
    ETUDE_RETURN_IF_ERROR(CheckTurns(spec, task));
  }
  auto impl = std::make_unique<Impl>(Impl{.spec = spec,
                                          .spec_sha256 = SpecHash(spec),
                                          .renderer = sim::RendererFor(spec, renderer),
                                          .grammar = std::move(grammar)});
  // what cannot be opened at all is said now, not at the first episode
  ETUDE_RETURN_IF_ERROR(impl->EnvironmentOf(PlanEpisode(spec, 0, 0).scene));
  return AttemptRunner(std::move(impl));
}

AttemptRunner::AttemptRunner(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
AttemptRunner::AttemptRunner(AttemptRunner&&) noexcept = default;
AttemptRunner::~AttemptRunner() = default;

namespace {

void KeepTimes(const Times& times, AttemptResult& result) {
  result.plan_s += times.plan;
  result.step_s += times.step;
  result.render_s += times.render;
  result.deflate_s += times.deflate;
}

AttemptResult Judged(const Verdict& verdict, const SceneDraws& draws, const Times& preparing, const Times& running) {
  AttemptResult result;
  result.outcome = verdict.outcome;
  result.reason = verdict.reason;
  result.scene = draws.Json();
  KeepTimes(preparing, result);
  KeepTimes(running, result);
  return result;
}

AttemptResult Invalid(std::string reason, const Times& preparing, const SceneDraws& draws = {}) {
  return Judged({AttemptOutcome::kSceneInvalid, std::move(reason)}, draws, preparing, {});
}

/// Of a scene that cannot be opened. What MuJoCo refuses it refuses on every machine: the attempt's own failure. All
/// else is this machine's fault, and no attempt.
Result<AttemptResult> WithoutScene(const Error& error, const Times& preparing) {
  if (error.code == Code::kInvalidArgument || error.code == Code::kInternal) return Invalid(error.message, preparing);
  return Fail(error);
}

}  // namespace

namespace {

OrderedJson FailureOf(EpisodeRunner& runner, const Verdict& verdict) {
  const Episode& episode = runner.episode();
  std::string stage = verdict.stage;
  if (stage.empty() && !episode.phase.empty() && episode.phase.back() < episode.stage_names.size())
    stage = episode.stage_names[episode.phase.back()];
  std::string pair;  // a violation of speed or torque is of a joint
  if (const auto& all = runner.judge().violations(); !all.empty()) {
    const bool touched =
        all.front().kind == Violation::Kind::kContact || all.front().kind == Violation::Kind::kSelfContact;
    if (touched && verdict.outcome == VerdictOnViolations(runner.judge()).outcome) pair = all.front().what;
  }
  const Eigen::Vector3d p = runner.world().X_WE().p;
  return {{"stage", stage}, {"pair", pair}, {"point", {p.x(), p.y(), p.z()}}};
}

}  // namespace

void AttemptRunner::OnProgress(std::function<void(std::string_view stage, int step)> progress) {
  impl_->progress = std::move(progress);
}

Result<AttemptResult> AttemptRunner::Demonstrate(std::uint64_t index, std::uint32_t attempt,
                                                 const SamplingWeights& weights, AttemptTrace* trace) {
  Impl& impl = *impl_;
  const EpisodePlan plan = PlanEpisode(impl.spec, index, attempt, weights);
  if (trace) trace->plan = plan;
  Times preparing;
  auto opened = impl.EnvironmentOf(plan.scene);
  if (!opened) return WithoutScene(opened.error(), preparing);
  EpisodeEnvironment& in = **opened;
  SceneDraws draws;
  {
    const plan::Timer watch(preparing.step);
    draws = in.Prepare(plan, impl.spec.randomization, impl.Drawing());
  }
  std::optional<Tracer> tracer;
  if (trace) tracer.emplace(in.scene, plan, impl.spec.image_stride, trace);
  if (!draws.ok()) return Invalid(draws.failure, preparing, draws);
  RecordConfig record{.image_stride = impl.spec.image_stride, .max_steps = kExpertMaxSteps};
  record.progress = impl.progress;
  if (tracer) record.observe = [&tracer](const sim::World& world) { tracer->Observe(world); };
  auto opened_runner = EpisodeRunner::Open({&in.world, &in.renderer, &in.shapes, &in.checker}, plan, record);
  if (!opened_runner) return Invalid(opened_runner.error().message, preparing, draws);
  EpisodeRunner& runner = *opened_runner;
  Expert expert(&runner, &in.planner, &in.checker, impl.spec.randomization);
  if (trace) expert.KeepMotions(&trace->motions);
  const Verdict verdict = expert.Run();
  if (trace) trace->effort.Add(runner.judge().violations());

  AttemptResult result = Judged(verdict, draws, preparing, runner.times());
  if (!verdict.ok()) result.failure = FailureOf(runner, verdict);
  if (!verdict.ok() && (!trace || runner.steps() == 0)) return result;
  runner.episode().details = expert.Statistics();
  impl.Finish(runner, verdict, impl.DrawInstruction(plan), result);
  return result;
}

Result<AttemptResult> AttemptRunner::Rollout(std::uint64_t index, const policy::AskFunction& ask) {
  Impl& impl = *impl_;
  const EpisodePlan plan = PlanEpisode(impl.spec, index, 0);
  Times preparing;
  auto opened = impl.EnvironmentOf(plan.scene);
  if (!opened) return WithoutScene(opened.error(), preparing);
  EpisodeEnvironment* const in = *opened;
  SceneDraws draws;
  {
    const plan::Timer watch(preparing.step);
    draws = in->Prepare(plan, impl.spec.randomization, impl.Drawing());
  }
  if (!draws.ok()) return Invalid(draws.failure, preparing, draws);
  RecordConfig record{.image_stride = impl.spec.image_stride,
                      .record_frames = impl.spec.rollout.record,
                      .max_steps = StepLimitOf(impl.spec.rollout, plan.scene.robot)};
  record.progress = impl.progress;
  std::optional<Occluder> occluder;
  if (const double share = impl.spec.rollout.occlude; share > 0) {
    occluder.emplace(&in->world, &in->renderer, plan.target, share, plan.seeds.occlusion);
    record.retouch = [&occluder](std::span<std::uint8_t> rgb) { occluder->Cover(rgb); };
  }
  auto opened_runner = EpisodeRunner::Open({&in->world, &in->renderer, &in->shapes, &in->checker}, plan, record);
  if (!opened_runner) return Invalid(opened_runner.error().message, preparing, draws);
  EpisodeRunner& runner = *opened_runner;
  const std::string instruction = impl.DrawInstruction(plan);
  task::Rollout rollout(&runner, &in->checker, in->scene, impl.spec.rollout, instruction);
  ETUDE_ASSIGN_OR_RETURN(const Verdict verdict, rollout.Run(ask));

  AttemptResult result = Judged(verdict, draws, preparing, runner.times());
  runner.episode().details = rollout.Details(verdict);
  if (occluder) runner.episode().details["occlusion"] = occluder->Report();
  impl.Finish(runner, verdict, instruction, result);
  return result;
}

Result<StartScene> AttemptRunner::Show(std::uint64_t index, std::uint32_t attempt) {
  Impl& impl = *impl_;
  const EpisodePlan plan = PlanEpisode(impl.spec, index, attempt);
  ETUDE_ASSIGN_OR_RETURN(EpisodeEnvironment* const in, impl.EnvironmentOf(plan.scene));
  if (const SceneDraws draws = in->Prepare(plan, impl.spec.randomization); !draws.ok())
    return Fail(Code::kNotFound,
                fmt::format("episode {}, attempt {}, has no scene: {}", index, attempt, draws.failure));
  return StartScene{
      .plan = plan, .instruction = impl.DrawInstruction(plan), .world = &in->world, .renderer = &in->renderer};
}

}  // namespace etude::task
