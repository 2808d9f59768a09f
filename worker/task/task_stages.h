// SPDX-License-Identifier: Apache-2.0
// The stages of a task as its file lists them, for one hand.
#pragma once

#include <vector>

#include "services/spec/campaign_spec.h"
#include "services/spec/task_name.h"
#include "worker/task/primitives/stage.h"

namespace etude::task {

/// The stages of `task` for a hand of these shapes: level hands grasp from the side, unless the task carries; others
/// from above.
/// @param clearance  m, wished from what the task avoids
std::vector<Stage> StagesOf(const TaskName& task, const SceneGeometry& shapes,
                            double clearance = ObstacleSpec().clearance);

}  // namespace etude::task
