// SPDX-License-Identifier: Apache-2.0
// Tasks as sequences of typed stages. Every goal is a function of what can be seen now (hand, object), not
// of what happened before: a policy without memory can then imitate it.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "worker/plan/planner.h"
#include "worker/task/geometry/scene_geometry.h"

namespace etude::task {

/// What a stage's goal may depend on.
struct StageContext {
  const SceneGeometry* shapes = nullptr;
  std::string target;
  std::string reference;     ///< relations: the object to put the target beside
  Pose X_WO;                 ///< target now
  Pose X_WR;                 ///< reference now
  Pose X_WE;                 ///< hand (reference) now
  std::optional<Pose> X_EO;  ///< target in the hand, while held
};

/// Tool pose to move to.
using Goal = std::function<Pose(const StageContext&)>;

struct Stage {
  enum class Effect { kNone, kGrasps, kReleases };  ///< what a stage that waits does to the target

  std::string name;
  Goal goal;              ///< empty for a stage that waits where the hand is
  Goal nearer = nullptr;  ///< where to go instead when the arm cannot be at `goal` without a collision
  bool closed = false;    ///< gripper command
  plan::Limits limits;
  double clearance = 0;          ///< m wished from obstacles; above 0 the potential field plans
  double margin = 0.002;         ///< m kept from everything, as far as the start keeps it
  bool detours_over = false;     ///< a detour goes over the objects instead of behind them
  bool straight_only = false;    ///< a detour would be worse than a failure
  bool touches_target = false;   ///< contact of hand and target is wanted
  bool nears_reference = false;  ///< the held target goes onto or into the reference: only contact is too near
  double held_back = 0;          ///< m that what it pushes may keep the hand from its goal
  bool holds = false;            ///< the target moves with the hand
  bool blends = false;           ///< runs into the next stage without stopping
  bool disturbable = false;      ///< a push off the path may happen
  double calm = 0;               ///< m before the goal where no push begins
  int back_to = 0;               ///< stages to go back after a push (realign before reaching again)
  int min_steps = 0;             ///< waiting stages: control steps, at least and
  int max_steps = 0;             ///< at most, until `done`
  std::function<bool(const sim::World&, const std::string& target)> done;
  Effect effect = Effect::kNone;

  bool moves() const { return static_cast<bool>(goal); }
};

/// A stage that moves what the hand holds.
Stage HeldStage(std::string_view name, Goal goal, const plan::Limits& limits);

/// Lowest point of what the hand holds below E when E is oriented q_WE, m. @pre now.X_EO
double HeldBelow(const StageContext& now, const Eigen::Quaterniond& q_WE);

}  // namespace etude::task
