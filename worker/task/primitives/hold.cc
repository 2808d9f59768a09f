// SPDX-License-Identifier: Apache-2.0
#include "worker/task/primitives/primitive.h"

namespace etude::task {

Stage MakeStage(const HoldSpec& spec, const Manner&) {
  return {.name = std::string(spec.kName), .touches_target = true, .min_steps = spec.steps, .max_steps = spec.steps};
}

}  // namespace etude::task
