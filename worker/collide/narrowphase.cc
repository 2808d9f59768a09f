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
  sim::Geometry::Shape shape;
  Eigen::Vector3d size;  ///< as in sim::Geometry, with the inflation
  std::vector<Eigen::Vector3d> vertices;
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

Eigen::Vector3d Inflated(const sim::Geometry& geometry, double inflation) {
  Eigen::Vector3d size = geometry.size;
  using enum sim::Geometry::Shape;
  if (geometry.shape == kBox) size.array() += inflation;
  if (geometry.shape == kSphere || geometry.shape == kCapsule || geometry.shape == kCylinder) size.x() += inflation;
  if (geometry.shape == kCylinder) size.y() += inflation;
  return size;
}

}  // namespace

Shape::Shape(const sim::Geometry& geometry, double inflation)
    : fcl_(std::make_shared<const Fcl>(
          Fcl{geometry.shape, Inflated(geometry, inflation), geometry.vertices, MakeGeometry(geometry, inflation)})) {}

Eigen::Vector3d Shape::Support(const Eigen::Vector3d& direction) const {
  const Eigen::Vector3d& size = fcl_->size;
  const auto end = [&direction](int axis, double half) { return direction[axis] < 0 ? -half : half; };
  using enum sim::Geometry::Shape;
  switch (fcl_->shape) {
    case kBox:
      return {end(0, size.x()), end(1, size.y()), end(2, size.z())};
    case kSphere:
      return direction.normalized() * size.x();
    case kCapsule:
      return Eigen::Vector3d(0, 0, end(2, size.y())) + direction.normalized() * size.x();
    case kCylinder: {
      const double across = direction.head<2>().norm();
      const double scale = across > 0 ? size.x() / across : 0;
      return {direction.x() * scale, direction.y() * scale, end(2, size.y())};
    }
    case kConvex:
      return *std::ranges::max_element(fcl_->vertices, {}, [&](const auto& vertex) { return vertex.dot(direction); });
  }
  return Eigen::Vector3d::Zero();
}

std::vector<Eigen::Vector3d> Shape::FaceNormals() const {
  using enum sim::Geometry::Shape;
  if (fcl_->shape == kCylinder) return {Eigen::Vector3d::UnitZ()};
  if (fcl_->shape != kBox) return {};
  return {Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY(), Eigen::Vector3d::UnitZ()};
}

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

namespace internal {

std::optional<FclDistance> AskDistance(const Shape& a, const Eigen::Isometry3d& X_WA, const Shape& b,
                                       const Eigen::Isometry3d& X_WB) {
  static const fcl::DistanceRequestd kRequest(/*enable_nearest_points=*/true);
  fcl::DistanceResultd result;
  try {
    FclDistance answer;
    answer.distance = fcl::distance(a.fcl().geometry.get(), X_WA, b.fcl().geometry.get(), X_WB, kRequest, result);
    if (!(answer.distance > 0)) return std::nullopt;
    answer.p_WA = result.nearest_points[0];
    answer.p_WB = result.nearest_points[1];
    return answer;
  } catch (const std::exception&) {
    return std::nullopt;
  }
}

std::optional<FclContact> AskContact(const Shape& a, const Eigen::Isometry3d& X_WA, const Shape& b,
                                     const Eigen::Isometry3d& X_WB) {
  static const fcl::CollisionRequestd kRequest(/*num_max_contacts=*/1, /*enable_contact=*/true);
  fcl::CollisionResultd result;
  try {
    if (fcl::collide(a.fcl().geometry.get(), X_WA, b.fcl().geometry.get(), X_WB, kRequest, result) == 0)
      return std::nullopt;
    // its normal points from A to B
    FclContact contact{result.getContact(0).pos, -result.getContact(0).normal};
    if (!contact.normal.allFinite() || contact.normal.norm() < 0.5) contact.normal.setZero();
    if (!contact.p_W.allFinite()) contact.p_W = (X_WA.translation() + X_WB.translation()) / 2;
    return contact;
  } catch (const std::exception&) {
    return FclContact{(X_WA.translation() + X_WB.translation()) / 2, Eigen::Vector3d::Zero()};
  }
}

}  // namespace internal
}  // namespace etude::collide
