// SPDX-License-Identifier: Apache-2.0
// Seeded planning problems of three difficulties for any arm that works over the table.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "services/core/result.h"
#include "worker/plan/planner.h"

namespace etude::plan {

enum class Difficulty {
  kOpen,       ///< two objects stand on the table, the hand moves above or beside them
  kCluttered,  ///< six objects stand about, the hand goes low to a place among them; every second straight way is
               ///< blocked
  kNarrow,     ///< into the gap between two of them, little wider than the hand; every straight way is blocked
};
inline constexpr Difficulty kDifficulties[] = {Difficulty::kOpen, Difficulty::kCluttered, Difficulty::kNarrow};
std::string_view ToString(Difficulty difficulty);
/// @error kInvalidArgument: names the known ones
Result<Difficulty> ParseDifficulty(const std::string& name);

struct PlanningScene {
  std::vector<std::pair<std::string, Pose>> objects;  ///< X_WO of those that are there
  Eigen::VectorXd q_start;
  Pose X_WE_goal;
};

/// Scene `index`: a pure function of its arguments. Start and goal are free by 5 mm, and the goal has a configuration
/// in the start's branch; whether a path joins them is for planners to find out.
/// @param checker  of this arm; its objects are moved
/// @returns nothing when a fixed number of draws had no such scene
std::optional<PlanningScene> DrawPlanningScene(const sim::Scene& scene, Difficulty difficulty, std::uint64_t seed,
                                               int index, sim::Kinematics& kinematics, collide::Checker& checker);

/// Puts the objects of `scene` where they stand, and all others out of reach.
void Place(const sim::Scene& scene, const PlanningScene& planning, collide::Checker& checker);

}  // namespace etude::plan
