// SPDX-License-Identifier: Apache-2.0
#include "worker/collide/narrowphase.h"

#include <fcl/geometry/shape/box.h>
#include <fcl/geometry/shape/capsule.h>
#include <fcl/geometry/shape/convex.h>
#include <fcl/geometry/shape/cylinder.h>
#include <fcl/geometry/shape/sphere.h>
#include <fcl/narrowphase/collision.h>
#include <fcl/narrowphase/distance.h>

#include <algorithm>
#include <exception>
#include <vector>

#include "services/core/check.h"

namespace etude::collide {

struct Shape::Fcl {
  std::unique_ptr<const fcl::CollisionGeometryd> geometry;
};

namespace {

std::unique_ptr<fcl::CollisionGeometryd> MakeConvex(const sim::Geometry& geometry) {
  ETUDE_CHECK(geometry.vertices.size() >= 4, "convex '{}' has {} vertices", geometry.name, geometry.vertices.size());

  // no faces: FCL then looks for extreme vertices by a linear scan, which needs none
  auto vertices = std::make_shared<const std::vector<Eigen::Vector3d>>(geometry.vertices);
  auto faces = std::make_shared<const std::vector<int>>();
  return std::make_unique<fcl::Convexd>(vertices, 0, faces, false);
}

std::unique_ptr<fcl::CollisionGeometryd> MakeGeometry(const sim::Geometry& geometry, double inflation) {
  const Eigen::Vector3d& size = geometry.size;
  using enum sim::Geometry::Shape;
  switch (geometry.shape) {
    case kBox:
      return std::make_unique<fcl::Boxd>(2 * (size.array() + inflation).matrix());
    case kSphere:
      return std::make_unique<fcl::Sphered>(size.x() + inflation);
    case kCapsule:
      return std::make_unique<fcl::Capsuled>(size.x() + inflation, 2 * size.y());
    case kCylinder:
      return std::make_unique<fcl::Cylinderd>(size.x() + inflation, 2 * (size.y() + inflation));
    case kConvex:
      ETUDE_CHECK(inflation == 0, "convex '{}' by {}", geometry.name, inflation);
      return MakeConvex(geometry);
  }
  ETUDE_CHECK(false, "shape of '{}'", geometry.name);
  return nullptr;
}

}  // namespace

Shape::Shape(const sim::Geometry& geometry, double inflation)
    : fcl_(std::make_shared<const Fcl>(Fcl{MakeGeometry(geometry, inflation)})) {}

bool Touch(const Shape& a, const Eigen::Isometry3d& X_WA, const Shape& b, const Eigen::Isometry3d& X_WB) {
  static const fcl::CollisionRequestd kRequest;
  fcl::CollisionResultd result;

  // libccd gives up on rare degenerate poses by throwing; the safe verdict is a collision
  try {
    return fcl::collide(a.fcl().geometry.get(), X_WA, b.fcl().geometry.get(), X_WB, kRequest, result) > 0;
  } catch (const std::exception&) {
    return true;
  }
}

double Distance(const Shape& a, const Eigen::Isometry3d& X_WA, const Shape& b, const Eigen::Isometry3d& X_WB) {
  if (Touch(a, X_WA, b, X_WB)) return 0;
  static const fcl::DistanceRequestd kRequest;
  fcl::DistanceResultd result;
  try {
    const double distance = fcl::distance(a.fcl().geometry.get(), X_WA, b.fcl().geometry.get(), X_WB, kRequest, result);
    return std::max(0.0, distance);
  } catch (const std::exception&) {
    return 0;
  }
}

}  // namespace etude::collide
