// SPDX-License-Identifier: Apache-2.0
// Names of tasks: a base task or a relation, alone or with something that the robot must not touch.
#pragma once

#include <string>
#include <vector>

#include "services/core/result.h"

namespace etude {

/// The object that stands in the way in tasks "...+obstacle".
inline constexpr const char* kObstacleObject = "basketball";

/// Whether a base task puts the target beside a second object, the reference.
inline bool IsRelation(const std::string& base) { return base.starts_with("place_"); }

/// "pick", "place_left", "push+obstacle", "pick+others"
struct TaskName {
  std::string base;   ///< pick | push | put_down | rotate | place_left | place_right | place_front | place_behind
  std::string avoid;  ///< "" | "obstacle" (kObstacleObject) | "others" (every object but the target)

  /// Puts the target beside a second object, as seen in the picture: left of, right of, in front of (nearer to
  /// the camera than) or behind it.
  bool relation() const { return IsRelation(base); }
  std::string text() const { return avoid.empty() ? base : base + "+" + avoid; }
};

const std::vector<std::string>& BaseTasks();
/// All that ParseTask takes.
const std::vector<std::string>& KnownTasks();
/// @error kInvalidArgument: unknown; the message has the nearest known one
Result<TaskName> ParseTask(const std::string& name);

}  // namespace etude
