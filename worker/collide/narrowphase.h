// SPDX-License-Identifier: Apache-2.0
// Convex shapes and the exact tests on a pair of them. Hides FCL from the rest of the folder.
#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <optional>
#include <vector>

#include "worker/sim/scene.h"

namespace etude::collide {

/// An immutable convex shape in its own frame G; a cheap handle.
class Shape {
 public:
  /// `geometry` grown by `inflation` (m). Contains every point within `inflation` of the original.
  /// Not for kConvex with inflation > 0.
  Shape(const sim::Geometry& geometry, double inflation);

  /// A point of the shape that is farthest along `direction`, both in G.
  Eigen::Vector3d Support(const Eigen::Vector3d& direction) const;

  /// Directions in G that are worth a look when the shape overlaps another: the normals of its faces, if it has few.
  std::vector<Eigen::Vector3d> FaceNormals() const;

  struct Fcl;
  const Fcl& fcl() const { return *fcl_; }

 private:
  std::shared_ptr<const Fcl> fcl_;
};

/// True when the shapes share a point. Deterministic.
bool Touch(const Shape& a, const Eigen::Isometry3d& X_WA, const Shape& b, const Eigen::Isometry3d& X_WB);
namespace internal {

struct FclDistance {
  double distance = 0;
  Eigen::Vector3d p_WA, p_WB;
};
/// FCL's own answer for shapes that do not touch: off by up to a millimetre for curved shapes, rarely by a centimetre
/// for boxes. Nothing where it gives up.
std::optional<FclDistance> AskDistance(const Shape& a, const Eigen::Isometry3d& X_WA, const Shape& b,
                                       const Eigen::Isometry3d& X_WB);

struct FclContact {
  Eigen::Vector3d p_W, normal;  ///< within both; from B to A, world, unit or (where FCL has none) zero
};
/// Nothing when the shapes share no point.
std::optional<FclContact> AskContact(const Shape& a, const Eigen::Isometry3d& X_WA, const Shape& b,
                                     const Eigen::Isometry3d& X_WB);

}  // namespace internal
}  // namespace etude::collide
