// SPDX-License-Identifier: Apache-2.0
// One attempt at one episode: scene from the seed, the expert or a policy at the controls, the success
// criterion, and the record of it. A pure function of (spec, index, attempt) (and, in a rollout, of the
// policy's answers).
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "services/episode/campaign_spec.h"
#include "services/episode/episode.h"
#include "worker/plan/planner.h"
#include "worker/sim/renderer.h"

namespace etude::task {

/// Why an attempt ended; the string forms are stable (attempts.jsonl, telemetry).
enum class AttemptOutcome {
  kSuccess,
  kSceneInvalid,     ///< objects could not be placed, or did not settle
  kPlanFailed,       ///< details say which stage and why (plan::OutcomeKind)
  kGraspMissed,      ///< fingers closed without the object
  kDropped,          ///< held, then lost
  kCriterionFailed,  ///< all stages ran, the success criterion says no
  kCollision,        ///< the robot, or what it moved, touched what it had to avoid
  kTimeout,          ///< longer than the step limit
  kUnstable,         ///< the simulation warned
  kPolicyError,      ///< rollout: the policy refused or did not answer
};
std::string_view ToString(AttemptOutcome outcome);

/// What a rollout asks of a policy: an observation in, kWaypoints waypoints and the modules' outputs out.
struct PolicyAnswer {
  std::vector<Waypoint> waypoints;
  OrderedJson modules;  ///< e.g. {"TAR3D": {"position": [x, y, z]}, ...}
  std::uint64_t checkpoint_step = 0;
};
struct PolicyQuestion {
  std::string instruction;
  std::vector<float> joints;  ///< arm joints then gripper joints
  int width = 0, height = 0;
  std::span<const std::uint8_t> rgb;
};
using PolicyFunction = std::function<Result<PolicyAnswer>(const PolicyQuestion&)>;

struct AttemptResult {
  AttemptOutcome outcome = AttemptOutcome::kSuccess;
  std::string reason;
  /// Complete on success; in a rollout complete always (episode.details has per-decision errors).
  Episode episode;
  double plan_s = 0, step_s = 0, render_s = 0, deflate_s = 0;  ///< where the time went
};

/// The scene of an attempt before anything moves, and what is asked for.
struct StartScene {
  std::string robot, task, target, reference, instruction;
  const sim::World* world = nullptr;  ///< valid until the runner's next call
  sim::Renderer* renderer = nullptr;
};

/// Runs attempts of one campaign. Owns world, renderer, planner; one per thread.
class AttemptRunner {
 public:
  /// @error kInvalidArgument, kUnavailable (no GL)
  static Result<AttemptRunner> Open(const CampaignSpec& spec, const sim::RendererConfig& renderer = {});
  AttemptRunner(AttemptRunner&&) noexcept;
  ~AttemptRunner();

  /// Mode demonstrate: plans and plays the expert.
  AttemptResult Demonstrate(std::uint64_t index, std::uint32_t attempt);
  /// Mode rollout: `policy` drives. @error only what `policy` returns.
  Result<AttemptResult> Rollout(std::uint64_t index, const PolicyFunction& policy);
  /// Neither: only sets the scene. @error kNotFound when (index, attempt) has none, and why.
  Result<StartScene> Show(std::uint64_t index, std::uint32_t attempt);

 private:
  struct Impl;
  explicit AttemptRunner(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::task
