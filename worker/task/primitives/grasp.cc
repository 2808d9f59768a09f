// SPDX-License-Identifier: Apache-2.0
#include "worker/task/primitives/primitive.h"

namespace etude::task {

Stage MakeStage(const GraspSpec& spec, const Manner&) {
  return {.name = std::string(spec.kName),
          .closed = true,
          .touches_target = true,
          .min_steps = spec.min_steps,
          .max_steps = spec.max_steps,
          .done = [](const sim::World& world, const std::string& target) { return world.Grasped(target); },
          .effect = Stage::Effect::kGrasps};
}

}  // namespace etude::task
