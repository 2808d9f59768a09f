// SPDX-License-Identifier: Apache-2.0
// Whether an arm's control can follow the motions that the expert will ask of it.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "worker/collide/checker.h"
#include "worker/sim/world.h"
#include "worker/task/effort.h"

namespace etude::task {

/// How the hand followed.
struct MotionCheck {
  int motions = 0;                   ///< that were moved
  std::vector<std::string> skipped;  ///< those that have no straight way from home, and why
  double lag = 0;                    ///< m, furthest from where the hand was due
  double lag_angle = 0;              ///< rad
  double rest = 0;                   ///< m off the end, 0.4 s after it was due, at most
  double rest_angle = 0;             ///< rad
  std::string worst;                 ///< the motion with the largest lag: "10 cm along +x"
  bool healthy = true;               ///< see World::healthy
  Effort effort;
};

/// Puts the objects of the scene far aside, where no arm meets them.
void ParkObjects(const sim::Scene& scene, sim::World& world);

/// From home and back: the hand 10 cm along each axis of the world, and turned about its own axis by 0.6 rad each way,
/// as fast as the expert approaches, slowed as the joints' speeds need it. The objects of the scene are not in the way.
MotionCheck CheckMotion(const std::shared_ptr<const sim::Scene>& scene);

}  // namespace etude::task
