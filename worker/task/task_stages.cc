// SPDX-License-Identifier: Apache-2.0
#include "worker/task/task_stages.h"

#include <algorithm>

#include "worker/task/primitives/primitive.h"
#include "worker/task/primitives/tuning.h"

namespace etude::task {
namespace {

Manner MannerOf(const TaskSpec& task, const SceneGeometry& shapes) {
  Manner manner{.pitch = shapes.natural_pitch(), .joint_speed = kStages.planned_speed * shapes.joint_speed()};
  if (task.carries()) manner.pitch = std::max(manner.pitch, kAbove.carry_pitch);
  for (const auto& stage : task.stages)
    if (const auto* carry = std::get_if<CarrySpec>(&stage))
      manner.lengthwise = carry->whereto() == Whereto::kLeft || carry->whereto() == Whereto::kRight;
  return manner;
}

// What follows from the stages' order.
void Connect(std::vector<Stage>& stages) {
  for (std::size_t i = 0; i < stages.size(); ++i) {
    Stage& stage = stages[i];
    stage.blends = stage.blends && i + 1 < stages.size() && stages[i + 1].moves();
    const bool only_waits = !stage.moves() && stage.effect == Stage::Effect::kNone;
    if (only_waits && i > 0) stage.closed = stages[i - 1].closed;
    // who goes back to align again goes to what moves, not to a wait before it
    const auto at = static_cast<int>(i);
    while (stage.back_to > 0 && stage.back_to < at && !stages[i - static_cast<std::size_t>(stage.back_to)].moves())
      ++stage.back_to;
  }
}

}  // namespace

std::vector<Stage> StagesOf(const TaskName& task, const SceneGeometry& shapes, double clearance) {
  const Manner manner = MannerOf(*task.spec, shapes);
  std::vector<Stage> stages;
  for (const StageSpec& spec : task.spec->stages)
    stages.push_back(std::visit([&](const auto& primitive) { return MakeStage(primitive, manner); }, spec));
  Connect(stages);
  const bool lays = task.spec->Has(TurnSpec::kName) && task.spec->Has(PlaceSpec::kName);
  for (Stage& stage : stages) {
    stage.detours_over = manner.above();
    // a palm that lays down from above is wider than the lane between two objects: no pushes out of it
    if (manner.above() && lays && stage.holds) stage.disturbable = false;
    // where contact is wanted the straight way is the short one: the field is for the ways in between
    if (!task.avoid.empty() && stage.moves() && !stage.straight_only) stage.clearance = clearance;
  }
  return stages;
}

}  // namespace etude::task
