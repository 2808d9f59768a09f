// SPDX-License-Identifier: Apache-2.0
// One compiled scene with everything that works in it, and how an attempt's start is put into it.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "services/spec/episode_plan.h"
#include "worker/sim/renderer.h"
#include "worker/task/episode_runner.h"
#include "worker/task/feasibility_check.h"
#include "worker/task/geometry/scene_geometry.h"
#include "worker/task/scene_sampling.h"
#include "worker/task/stage_planner.h"

namespace etude::task {

/// How the start of an attempt was found.
struct SceneDraws {
  std::vector<Rejection> rejected;  ///< of the starts drawn, in their order
  bool found = false;               ///< one more was taken
  std::string failure;              ///< why the attempt has no start after all; empty when it has

  bool ok() const { return failure.empty(); }
  /// {"draws", "rejected": [{"reason", "detail"}, ...]}: see services/episode/attempt_details.h.
  OrderedJson Json() const;
};

/// One per thread. Attempts leave it in any state: Prepare starts anew.
struct EpisodeEnvironment {
  /// @error kInvalidArgument (an unknown robot or object), kUnavailable (no GL)
  static Result<std::unique_ptr<EpisodeEnvironment>> Open(const SceneSpec& spec, const sim::RendererConfig& renderer);

  /// Puts world and checker into the start of an attempt: objects, obstacle, distractors and arm drawn from the plan's
  /// seeds, at rest, and such that the task can be done (see feasibility_check.h); and the renderer into the plan's
  /// world.
  /// @param drawing  told the number of each start before it is drawn, from 0: a hard task may need many
  /// @pre this is the environment of `plan.scene`
  SceneDraws Prepare(const EpisodePlan& plan, const RandomizationSpec& randomization,
                     const std::function<void(int start)>& drawing = nullptr);

  std::shared_ptr<const sim::Scene> scene;
  sim::World world;
  sim::Renderer renderer;
  collide::Checker checker;
  StagePlanner planner;
  SceneGeometry shapes;

 private:
  EpisodeEnvironment(std::shared_ptr<const sim::Scene> scene, sim::Renderer renderer);
  struct Start {
    std::vector<PlacedObject> objects;
    Eigen::VectorXd q;
  };
  /// The scene's objects by what they are there for.
  struct Things {
    std::vector<sim::ObjectInfo> objects, distractors;
    std::optional<sim::ObjectInfo> ball;  ///< the obstacle
  };
  Things ThingsOf(const EpisodePlan& plan) const;
  /// The streams that a start is drawn from.
  struct Streams {
    Rng scene, distractors, places;
  };
  /// The objects on the table; nothing when no arrangement was found.
  std::optional<std::vector<PlacedObject>> Arrange(const EpisodePlan& plan, const std::vector<sim::ObjectInfo>& objects,
                                                   double yaw, Streams& streams) const;
  /// One draw. `why` gets the reason when it returns nothing.
  std::optional<Start> Draw(const EpisodePlan& plan, const std::vector<Stage>& stages,
                            const RandomizationSpec& randomization, Streams& streams, Rejection& why);
  /// Adds the distractors to a start in which the task can be done, so that it still can.
  std::optional<Rejection> AddDistractors(const EpisodePlan& plan, const std::vector<Stage>& stages,
                                          const StageContext& now, double yaw, Start& start, Rng& rng);
  std::optional<Eigen::VectorXd> DrawArm(const EpisodePlan& plan, const RandomizationSpec& randomization, Rng& rng);
  std::optional<std::string> Settle(const Start& start);
};

}  // namespace etude::task
