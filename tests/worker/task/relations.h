// SPDX-License-Identifier: Apache-2.0
// Where the built-in relations want their target, for tests that look at poses.
#pragma once

#include <string>

#include "worker/task/predicates/geometry.h"

namespace etude::task {

/// "left" for place_left, ... @pre place_left | place_right | place_front | place_behind
inline std::string SideOf(const std::string& relation) { return relation.substr(std::string("place_").size()); }

/// In W, as seen in the picture.
inline Eigen::Vector3d DirectionOf(const std::string& relation) { return DirectionOfSide(SideOf(relation)); }

/// Whether p_WO is already where the relation to p_WR wants it.
inline bool IsBeside(const std::string& relation, const Eigen::Vector3d& p_WO, const Eigen::Vector3d& p_WR) {
  return IsOnSide(SideOf(relation), p_WO, p_WR);
}

}  // namespace etude::task
