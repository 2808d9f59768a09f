// SPDX-License-Identifier: Apache-2.0
#include "worker/task/attempt.h"

#include <fmt/format.h>

#include <optional>

#include "services/core/check.h"
#include "services/language/grammar.h"
#include "worker/task/chain.h"
#include "worker/task/expert.h"
#include "worker/task/rollout.h"
#include "worker/task/scene_sampling.h"
#include "worker/task/session.h"
#include "worker/task/shapes.h"

namespace etude::task {
namespace {

constexpr int kSettleSteps = 25;          // before an attempt: objects come to rest
constexpr double kSettleDistance = 0.01;  // m that an object may move meanwhile
constexpr int kExpertMaxSteps = 1500;

std::string DrawInstruction(const language::Grammar& grammar, const SessionConfig& config, std::uint64_t seed) {
  Rng rng(MixSeed({seed}, "language"));
  return grammar.Sample({config.task, config.target}, language::Style::kTemplate, rng);
}

}  // namespace

std::string_view ToString(AttemptOutcome outcome) {
  switch (outcome) {
    case AttemptOutcome::kSuccess:
      return "success";
    case AttemptOutcome::kSceneInvalid:
      return "scene_invalid";
    case AttemptOutcome::kPlanFailed:
      return "plan_failed";
    case AttemptOutcome::kGraspMissed:
      return "grasp_missed";
    case AttemptOutcome::kDropped:
      return "dropped";
    case AttemptOutcome::kCriterionFailed:
      return "criterion_failed";
    case AttemptOutcome::kTimeout:
      return "timeout";
    case AttemptOutcome::kUnstable:
      return "unstable";
    case AttemptOutcome::kPolicyError:
      return "policy_error";
  }
  return "unknown";
}

struct AttemptRunner::Impl {
  Impl(const CampaignSpec& spec_in, std::shared_ptr<const sim::Scene> scene_in, sim::Renderer renderer_in,
       language::Grammar grammar_in)
      : spec(spec_in),
        spec_sha256(SpecHash(spec_in)),
        scene(scene_in),
        world(scene_in),
        renderer(std::move(renderer_in)),
        checker(scene_in),
        planner(scene_in, &checker),
        shapes(*scene_in, planner.kinematics()),
        grammar(std::move(grammar_in)) {}

  /// Puts world and checker into the scene of `seed`. @returns why it is invalid, or nothing.
  std::optional<std::string> Prepare(std::uint64_t seed);
  std::optional<std::string> SettleObjects(const std::vector<PlacedObject>& objects);
  SessionConfig ConfigOf(std::uint64_t index) const;
  /// Fills in identity and meaning and hands the episode over.
  void Finish(Session& session, const Verdict& verdict, std::uint64_t index, std::uint32_t attempt,
              const std::string& instruction, AttemptResult& result);

  CampaignSpec spec;
  std::string spec_sha256;
  std::shared_ptr<const sim::Scene> scene;
  sim::World world;
  sim::Renderer renderer;
  collide::Checker checker;
  StagePlanner planner;
  Shapes shapes;
  language::Grammar grammar;
};

SessionConfig AttemptRunner::Impl::ConfigOf(std::uint64_t index) const {
  return {.task = TaskOf(spec, index),
          .target = TargetOf(spec, index),
          .image_stride = spec.image_stride,
          .max_steps = kExpertMaxSteps};
}

std::optional<std::string> AttemptRunner::Impl::Prepare(std::uint64_t seed) {
  Rng rng(MixSeed({seed}, "scene"));
  world.Reset();
  Rng light_rng(MixSeed({seed}, "light"));
  renderer.SetAppearance(sim::DrawAppearance(spec.randomization.light, scene->body_count(), light_rng));
  checker.Allow({});
  checker.SetGripper(0);
  for (const auto& object : scene->objects()) checker.Attach(object.name, std::nullopt);
  const auto objects = PlaceObjects(scene->objects(), spec.randomization.yaw, rng);
  if (!objects) return "no arrangement of the objects found";
  for (const auto& object : *objects) {
    world.SetObject(object.name, object.X_WO);
    checker.SetObject(object.name, object.X_WO);
  }
  const auto q_start = DrawStart(scene->arm(), spec.randomization, planner.kinematics(), checker, rng);
  if (!q_start) return "no free start of the arm found";
  world.SetArm(*q_start);
  world.Forward();
  return SettleObjects(*objects);
}

std::optional<std::string> AttemptRunner::Impl::SettleObjects(const std::vector<PlacedObject>& objects) {
  const Waypoint here{world.X_WE(), 0};
  for (int t = 0; t < kSettleSteps; ++t) world.Step(here, Vector6::Zero());
  if (!world.healthy()) return "the simulation is unstable";
  for (const auto& object : objects) {
    const Pose X_WO = world.ObjectPose(object.name);
    const double moved = (X_WO.p - object.X_WO.p).norm();
    const double tilt = AngleBetween(X_WO.q, object.X_WO.q);
    if (moved > kSettleDistance || tilt > 0.05)
      return fmt::format("{} moved by {:.3f} m, {:.2f} rad while settling", object.name, moved, tilt);
  }
  return std::nullopt;
}

void AttemptRunner::Impl::Finish(Session& session, const Verdict& verdict, std::uint64_t index, std::uint32_t attempt,
                                 const std::string& instruction, AttemptResult& result) {
  Episode& episode = session.episode();
  episode.campaign = spec.name;
  episode.index = index;
  episode.attempt = attempt;
  episode.seed = EpisodeSeed(spec, index, attempt);
  episode.spec_sha256 = spec_sha256;
  episode.scene_sha256 = scene->sha256();
  episode.version = ETUDE_VERSION;
  episode.robot = spec.robot;
  episode.instruction = instruction;
  episode.success = verdict.ok();
  episode.outcome = ToString(verdict.outcome);
  result.episode = std::move(episode);
}

Result<AttemptRunner> AttemptRunner::Open(const CampaignSpec& spec, const sim::RendererConfig& renderer_config) {
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  ETUDE_ASSIGN_OR_RETURN(auto scene, sim::Scene::Build(spec));
  ETUDE_ASSIGN_OR_RETURN(auto renderer, sim::Renderer::Open(scene, renderer_config));
  ETUDE_ASSIGN_OR_RETURN(auto grammar, language::Grammar::Load());
  return AttemptRunner(std::make_unique<Impl>(spec, scene, std::move(renderer), std::move(grammar)));
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

AttemptResult Invalid(std::string reason, const Times& times) {
  AttemptResult result;
  result.outcome = AttemptOutcome::kSceneInvalid;
  result.reason = std::move(reason);
  KeepTimes(times, result);
  return result;
}

}  // namespace

AttemptResult AttemptRunner::Demonstrate(std::uint64_t index, std::uint32_t attempt) {
  Impl& impl = *impl_;
  const std::uint64_t seed = EpisodeSeed(impl.spec, index, attempt);
  Times preparing;
  {
    const Stopwatch watch(preparing.step);
    const auto invalid = impl.Prepare(seed);
    if (invalid) return Invalid(*invalid, preparing);
  }
  const SessionConfig config = impl.ConfigOf(index);
  Session session({&impl.world, &impl.renderer, &impl.shapes}, config);
  Expert expert(&session, &impl.planner, &impl.checker, impl.spec.randomization, seed);
  const Verdict verdict = expert.Run();

  AttemptResult result;
  result.outcome = verdict.outcome;
  result.reason = verdict.reason;
  KeepTimes(preparing, result);
  KeepTimes(session.times(), result);
  if (!verdict.ok()) return result;
  session.episode().details = expert.Statistics();
  session.episode().details["disturbed_objects"] = session.disturbed();
  impl.Finish(session, verdict, index, attempt, DrawInstruction(impl.grammar, config, seed), result);
  return result;
}

Result<AttemptResult> AttemptRunner::Rollout(std::uint64_t index, const PolicyFunction& policy) {
  Impl& impl = *impl_;
  const std::uint64_t seed = EpisodeSeed(impl.spec, index, 0);
  Times preparing;
  {
    const Stopwatch watch(preparing.step);
    const auto invalid = impl.Prepare(seed);
    if (invalid) return Invalid(*invalid, preparing);
  }
  SessionConfig config = impl.ConfigOf(index);
  config.record_frames = impl.spec.rollout.record;
  config.max_steps = impl.spec.rollout.max_steps;
  Session session({&impl.world, &impl.renderer, &impl.shapes}, config);
  const std::string instruction = DrawInstruction(impl.grammar, config, seed);
  task::Rollout rollout(&session, &impl.checker, impl.spec.rollout, instruction);
  ETUDE_ASSIGN_OR_RETURN(const Verdict verdict, rollout.Run(policy));

  AttemptResult result;
  result.outcome = verdict.outcome;
  result.reason = verdict.reason;
  KeepTimes(preparing, result);
  KeepTimes(session.times(), result);
  session.episode().details = rollout.Details(verdict);
  impl.Finish(session, verdict, index, 0, instruction, result);
  return result;
}

Result<StartScene> AttemptRunner::Show(std::uint64_t index, std::uint32_t attempt) {
  Impl& impl = *impl_;
  const std::uint64_t seed = EpisodeSeed(impl.spec, index, attempt);
  if (const auto invalid = impl.Prepare(seed))
    return Fail(Code::kNotFound, fmt::format("episode {}, attempt {}, has no scene: {}", index, attempt, *invalid));
  const SessionConfig config = impl.ConfigOf(index);
  return StartScene{config.task, config.target, DrawInstruction(impl.grammar, config, seed), &impl.world,
                    &impl.renderer};
}

}  // namespace etude::task
