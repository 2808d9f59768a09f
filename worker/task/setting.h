// SPDX-License-Identifier: Apache-2.0
// One compiled scene with everything that works in it, and how an attempt's start is put into it.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "services/episode/campaign_spec.h"
#include "worker/sim/renderer.h"
#include "worker/task/chain.h"
#include "worker/task/scene_sampling.h"
#include "worker/task/session.h"
#include "worker/task/shapes.h"

namespace etude::task {

/// One per thread. Attempts leave it in any state: Prepare starts anew.
struct Setting {
  /// @error kInvalidArgument (an unknown robot or object), kUnavailable (no GL)
  static Result<std::unique_ptr<Setting>> Open(const SceneSpec& spec, const sim::RendererConfig& renderer);

  /// Puts world and checker into the start of an attempt: objects, obstacle and arm drawn from `seed`, at rest, and
  /// such that the task can be done (see rehearsal.h).
  /// @returns why there is no such start, or nothing.
  std::optional<std::string> Prepare(const SessionConfig& config, const RandomizationSpec& randomization,
                                     ObstaclePlace obstacle, std::uint64_t seed);

  std::shared_ptr<const sim::Scene> scene;
  sim::World world;
  sim::Renderer renderer;
  collide::Checker checker;
  StagePlanner planner;
  Shapes shapes;

 private:
  Setting(std::shared_ptr<const sim::Scene> scene, sim::Renderer renderer);
  struct Start {
    std::vector<PlacedObject> objects;
    Eigen::VectorXd q;
  };
  /// One draw. `why` gets the reason when it returns nothing.
  std::optional<Start> Draw(const SessionConfig& config, const std::vector<Stage>& stages,
                            const RandomizationSpec& randomization, ObstaclePlace obstacle, Rng& rng, std::string& why);
  std::optional<Eigen::VectorXd> DrawArm(const SessionConfig& config, const RandomizationSpec& randomization, Rng& rng);
  std::optional<std::string> Settle(const Start& start);
};

}  // namespace etude::task
