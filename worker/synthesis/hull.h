// SPDX-License-Identifier: Apache-2.0
// Convex hulls of small point sets.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "worker/assets/mesh.h"

namespace etude::synthesis {

/// At most about `count` of the points: those that reach farthest in as many directions, spread evenly over the sphere
/// after the points' box has been made a cube. The hull of the rest is nearly that of all.
std::vector<Eigen::Vector3d> FarthestPoints(const std::vector<Eigen::Vector3d>& points, int count);

/// The convex hull as a closed mesh, wound outwards, every corner one of `points`; nothing when the points lie in a
/// plane. Points closer to the hull than a hundred thousandth of its size may be left out. No texture coordinates of
/// meaning. Cost: O(points^2). Source: the incremental method, e.g. O'Rourke, "Computational Geometry in C", chapter 4.
std::optional<assets::Mesh> ConvexHull(const std::vector<Eigen::Vector3d>& points);

/// The convex hull of at most `count` of the points, those that it needs most: the farthest in some directions, then
/// one after the other what sticks out most. Nothing when the points lie in a plane.
std::optional<assets::Mesh> FittedHull(const std::vector<Eigen::Vector3d>& points, int count);

}  // namespace etude::synthesis
