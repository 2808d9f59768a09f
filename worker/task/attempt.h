// SPDX-License-Identifier: Apache-2.0
// One attempt at one episode: scene from the seed, the expert or a policy at the controls, the success
// criterion, and the record of it. A pure function of (spec, sampling weights, index, attempt) (and, in a rollout, of
// the policy's answers).
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "services/episode/episode.h"
#include "services/policy/policy_types.h"
#include "services/spec/episode_plan.h"
#include "worker/plan/planner.h"
#include "worker/sim/renderer.h"
#include "worker/task/trace.h"
#include "worker/task/verdict.h"

namespace etude::task {

struct AttemptResult {
  AttemptOutcome outcome = AttemptOutcome::kSuccess;
  std::string reason;
  /// Complete on success; in a rollout complete always (episode.details has per-decision errors).
  Episode episode;
  OrderedJson scene = OrderedJson::object();  ///< SceneDraws::Json, of failures too
  /// Of a demonstration that failed: "stage" in which it did, "pair" that touched and should not have ("" when none
  /// did), "point": where the hand was then, m in the world.
  OrderedJson failure = OrderedJson::object();
  double plan_s = 0, step_s = 0, render_s = 0, deflate_s = 0;  ///< where the time went
};

/// The scene of an attempt before anything moves, and what is asked for.
struct StartScene {
  EpisodePlan plan;
  std::string instruction;
  const sim::World* world = nullptr;  ///< valid until the runner's next call
  sim::Renderer* renderer = nullptr;
};

/// Runs attempts of one campaign. Owns world, renderer, planner; one per thread.
class AttemptRunner {
 public:
  /// Draws with `renderer` as the spec asks for it.
  /// @error kInvalidArgument, kUnavailable (no GL, or no GPU where the spec asks for one)
  static Result<AttemptRunner> Open(const CampaignSpec& spec, const sim::RendererConfig& renderer = {});
  AttemptRunner(AttemptRunner&&) noexcept;
  ~AttemptRunner();

  /// Mode demonstrate: plans and plays the expert.
  /// @param weights  the sampling weights that hold for `index`
  /// @param trace  gets what a replay shows; the episode then is complete after a failure too, unless it has no step.
  /// @error the scene cannot be opened: the machine's fault, no failed attempt
  Result<AttemptResult> Demonstrate(std::uint64_t index, std::uint32_t attempt, const SamplingWeights& weights = {},
                                    AttemptTrace* trace = nullptr);
  /// Mode rollout: the policy behind `ask` drives. @error what `ask` returns; the scene cannot be opened, as above.
  Result<AttemptResult> Rollout(std::uint64_t index, const policy::AskFunction& ask);
  /// From now on told before every control step of an attempt which stage it is in and how many steps are done; before
  /// the first one, "start" and how many starts were drawn without finding one in which the task can be done.
  void OnProgress(std::function<void(std::string_view stage, int step)> progress);
  /// Neither: only sets the scene. @error kNotFound when (index, attempt) has none, and why.
  Result<StartScene> Show(std::uint64_t index, std::uint32_t attempt);

 private:
  struct Impl;
  explicit AttemptRunner(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::task
