// SPDX-License-Identifier: Apache-2.0
// Shapes of every kind and places for them.
#pragma once

#include "services/core/rng.h"
#include "worker/collide/pieces.h"

namespace etude::collide {

using GeometryShape = sim::Geometry::Shape;

inline constexpr GeometryShape kShapes[] = {GeometryShape::kBox, GeometryShape::kSphere, GeometryShape::kCapsule,
                                            GeometryShape::kCylinder, GeometryShape::kConvex};

/// @param size  as sim::Geometry::size; of kConvex the half sizes of a box
inline sim::Geometry Make(GeometryShape shape, const Eigen::Vector3d& size) {
  sim::Geometry geometry;
  geometry.name = geometry.body = "piece";
  geometry.shape = shape;
  geometry.size = size;
  if (shape == GeometryShape::kConvex)
    for (int corner = 0; corner < 8; ++corner)
      geometry.vertices.emplace_back(corner & 1 ? size.x() : -size.x(), corner & 2 ? size.y() : -size.y(),
                                     corner & 4 ? size.z() : -size.z());
  return geometry;
}

inline Eigen::Isometry3d At(double x, double y, double z) { return Eigen::Isometry3d(Eigen::Translation3d(x, y, z)); }

/// Within a cube of half size `reach`, turned any way.
inline Eigen::Isometry3d RandomPose(Rng& rng, double reach) {
  Pose X;
  X.p = {rng.Uniform(-reach, reach), rng.Uniform(-reach, reach), rng.Uniform(-reach, reach)};
  X.q = Eigen::Quaterniond(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal()).normalized();
  return internal::ToIsometry(X);
}

}  // namespace etude::collide
