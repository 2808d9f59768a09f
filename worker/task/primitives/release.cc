// SPDX-License-Identifier: Apache-2.0
#include "worker/task/primitives/primitive.h"

namespace etude::task {

Stage MakeStage(const ReleaseSpec& spec, const Manner&) {
  return {.name = std::string(spec.kName),
          .touches_target = true,
          .min_steps = spec.steps,
          .max_steps = spec.steps,
          .effect = Stage::Effect::kReleases};
}

}  // namespace etude::task
