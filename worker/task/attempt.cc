// SPDX-License-Identifier: Apache-2.0
#include "worker/task/attempt.h"

#include <fmt/format.h>

#include <algorithm>
#include <list>
#include <optional>

#include "services/core/check.h"
#include "services/episode/object_names.h"
#include "services/language/grammar.h"
#include "worker/task/expert.h"
#include "worker/task/rollout.h"
#include "worker/task/setting.h"

namespace etude::task {
namespace {

constexpr int kExpertMaxSteps = 2500;
constexpr std::size_t kKeptSettings = 6;  // compiled scenes kept for later episodes

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
    case AttemptOutcome::kCollision:
      return "collision";
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
  /// The setting of episode `index`: made, or one of those made last.
  Result<Setting*> SettingOf(std::uint64_t index);
  SessionConfig ConfigOf(std::uint64_t index) const;
  std::optional<std::string> Prepare(Setting& setting, const SessionConfig& config, std::uint64_t index,
                                     std::uint64_t seed) const {
    return setting.Prepare(config, spec.randomization, ObstaclePlaceOf(spec, index), seed);
  }
  std::string DrawInstruction(const SessionConfig& config, std::uint64_t seed) const;
  /// Fills in identity and meaning and hands the episode over.
  void Finish(Session& session, const Verdict& verdict, std::uint64_t index, std::uint32_t attempt,
              const std::string& instruction, AttemptResult& result) const;

  CampaignSpec spec;
  std::string spec_sha256;
  sim::RendererConfig renderer;
  language::Grammar grammar;
  struct Kept {
    SceneSpec spec;
    std::unique_ptr<Setting> setting;
  };
  std::list<Kept> settings;  ///< the one used last first
};

Result<Setting*> AttemptRunner::Impl::SettingOf(std::uint64_t index) {
  const SceneSpec wanted = SceneOf(spec, index);
  auto it = std::find_if(settings.begin(), settings.end(), [&](const Kept& kept) { return kept.spec == wanted; });
  if (it == settings.end()) {
    ETUDE_ASSIGN_OR_RETURN(auto setting, Setting::Open(wanted, renderer));
    if (settings.size() >= kKeptSettings) settings.pop_back();
    it = settings.insert(settings.begin(), {wanted, std::move(setting)});
  }
  settings.splice(settings.begin(), settings, it);
  return it->setting.get();
}

SessionConfig AttemptRunner::Impl::ConfigOf(std::uint64_t index) const {
  const auto task = ParseTask(TaskOf(spec, index));
  ETUDE_CHECK(task, "task={}", TaskOf(spec, index));
  SessionConfig config{.task = *task,
                       .target = TargetOf(spec, index),
                       .reference = ReferenceOf(spec, index),
                       .image_stride = spec.image_stride,
                       .max_steps = kExpertMaxSteps};
  if (task->avoid == "obstacle") config.avoid = {kObstacleObject};
  if (task->avoid == "others") {
    config.avoid = SceneNames(SceneOf(spec, index).objects);
    std::erase(config.avoid, config.target);
  }
  return config;
}

std::string AttemptRunner::Impl::DrawInstruction(const SessionConfig& config, std::uint64_t seed) const {
  Rng rng(MixSeed({seed}, "language"));
  return grammar.Sample(language::CommandFor(config.task, config.target, config.reference), language::Style::kTemplate,
                        rng);
}

void AttemptRunner::Impl::Finish(Session& session, const Verdict& verdict, std::uint64_t index, std::uint32_t attempt,
                                 const std::string& instruction, AttemptResult& result) const {
  Episode& episode = session.episode();
  const SceneSpec scene = SceneOf(spec, index);
  episode.campaign = spec.name;
  episode.index = index;
  episode.attempt = attempt;
  episode.seed = EpisodeSeed(spec, index, attempt);
  episode.spec_sha256 = spec_sha256;
  episode.scene_sha256 = session.world().scene().sha256();
  episode.version = ETUDE_VERSION;
  episode.robot = scene.robot;
  episode.instruction = instruction;
  episode.success = verdict.ok();
  episode.outcome = ToString(verdict.outcome);
  episode.details["disturbed_objects"] = session.disturbed();
  if (session.config().task.avoid == "obstacle")
    episode.details["in_the_way"] = ObstaclePlaceOf(spec, index) == ObstaclePlace::kInTheWay;
  result.episode = std::move(episode);
}

Result<AttemptRunner> AttemptRunner::Open(const CampaignSpec& spec, const sim::RendererConfig& renderer) {
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  ETUDE_ASSIGN_OR_RETURN(auto grammar, language::Grammar::LoadFor(SceneNames(spec.objects)));
  auto impl = std::make_unique<Impl>(
      Impl{.spec = spec, .spec_sha256 = SpecHash(spec), .renderer = renderer, .grammar = std::move(grammar)});
  // what cannot be opened at all is said now, not at the first episode
  ETUDE_RETURN_IF_ERROR(impl->SettingOf(0));
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
  const SessionConfig config = impl.ConfigOf(index);
  Times preparing;
  auto opened = impl.SettingOf(index);
  if (!opened) return Invalid(opened.error().message, preparing);
  Setting& setting = **opened;
  {
    const Stopwatch watch(preparing.step);
    const auto invalid = impl.Prepare(setting, config, index, seed);
    if (invalid) return Invalid(*invalid, preparing);
  }
  Session session({&setting.world, &setting.renderer, &setting.shapes}, config);
  Expert expert(&session, &setting.planner, &setting.checker, impl.spec.randomization, seed);
  const Verdict verdict = expert.Run();

  AttemptResult result;
  result.outcome = verdict.outcome;
  result.reason = verdict.reason;
  KeepTimes(preparing, result);
  KeepTimes(session.times(), result);
  if (!verdict.ok()) return result;
  session.episode().details = expert.Statistics();
  impl.Finish(session, verdict, index, attempt, impl.DrawInstruction(config, seed), result);
  return result;
}

Result<AttemptResult> AttemptRunner::Rollout(std::uint64_t index, const PolicyFunction& policy) {
  Impl& impl = *impl_;
  const std::uint64_t seed = EpisodeSeed(impl.spec, index, 0);
  SessionConfig config = impl.ConfigOf(index);
  Times preparing;
  ETUDE_ASSIGN_OR_RETURN(Setting* const setting, impl.SettingOf(index));
  {
    const Stopwatch watch(preparing.step);
    const auto invalid = impl.Prepare(*setting, config, index, seed);
    if (invalid) return Invalid(*invalid, preparing);
  }
  config.record_frames = impl.spec.rollout.record;
  config.max_steps = impl.spec.rollout.max_steps;
  Session session({&setting->world, &setting->renderer, &setting->shapes}, config);
  const std::string instruction = impl.DrawInstruction(config, seed);
  task::Rollout rollout(&session, &setting->checker, impl.spec.rollout, instruction);
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
  const SessionConfig config = impl.ConfigOf(index);
  ETUDE_ASSIGN_OR_RETURN(Setting* const setting, impl.SettingOf(index));
  if (const auto invalid = impl.Prepare(*setting, config, index, seed))
    return Fail(Code::kNotFound, fmt::format("episode {}, attempt {}, has no scene: {}", index, attempt, *invalid));
  return StartScene{.robot = SceneOf(impl.spec, index).robot,
                    .task = config.task.text(),
                    .target = config.target,
                    .reference = config.reference,
                    .instruction = impl.DrawInstruction(config, seed),
                    .world = &setting->world,
                    .renderer = &setting->renderer};
}

}  // namespace etude::task
