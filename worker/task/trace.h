// SPDX-License-Identifier: Apache-2.0
// What a replay of an attempt keeps beyond its episode: the motions as they were planned, where every body was, and
// what the arm came near to.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "services/spec/episode_plan.h"
#include "worker/collide/checker.h"
#include "worker/plan/planner.h"
#include "worker/task/effort.h"

namespace etude::task {

/// A motion that was begun. It need not have been played to its end.
struct PlayedMotion {
  int step = 0;                     ///< control step of the episode at which it began
  std::vector<std::string> stages;  ///< that it goes through without stopping
  bool disturbance = false;         ///< a push off the path
  plan::Motion motion;
};

struct AttemptTrace {
  EpisodePlan plan;
  std::shared_ptr<const sim::Scene> scene;  ///< null when it could not be built
  std::vector<PlayedMotion> motions;
  std::vector<std::string> bodies;       ///< of the robot, then the objects
  std::vector<std::vector<Pose>> poses;  ///< [control step][body], in world
  /// The nearest pair of the arm and everything else, contact with the target apart.
  struct Near {
    int step = 0;
    collide::Collision pair;
    std::optional<collide::Proximity> where;  ///< the same pair with its points, where it has some
  };
  std::vector<Near> nearest;  ///< every so many steps
  Effort effort;
};

/// Looks at a world step by step. It has a checker of its own, so that what is traced is what happens untraced.
class Tracer {
 public:
  /// @param stride  control steps between two measurements of distance
  Tracer(std::shared_ptr<const sim::Scene> scene, const EpisodePlan& plan, int stride, AttemptTrace* trace);

  /// The state before the next control step.
  void Observe(const sim::World& world);

 private:
  collide::Checker checker_;
  std::string target_;
  int stride_;
  AttemptTrace* trace_;
};

}  // namespace etude::task
