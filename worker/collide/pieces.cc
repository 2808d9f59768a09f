// SPDX-License-Identifier: Apache-2.0
#include "worker/collide/pieces.h"

#include <algorithm>
#include <cmath>

#include "worker/collide/separation.h"

namespace etude::collide::internal {

Eigen::Isometry3d ToIsometry(const Pose& pose) {
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  X.linear() = pose.q.toRotationMatrix();
  X.translation() = pose.p;
  return X;
}

Piece::Piece(const sim::Geometry& geometry, Role role, int body)
    : geometry_(geometry),
      role_(role),
      body_(body),
      shape_(geometry, 0),
      X_BG_(ToIsometry(geometry.X_BG)),
      center_(Eigen::Vector3d::Zero()),
      half_(Eigen::Vector3d::Zero()) {
  const bool convex = geometry.shape == sim::Geometry::Shape::kConvex;
  if (role == Role::kArm && !convex) {
    self_inflated_.emplace(geometry, kSelfMargin);
    self_roomy_.emplace(geometry, kSelfRoom);
  }
  if (convex) {
    Eigen::Vector3d lower = geometry.vertices.front(), upper = lower;
    for (const Eigen::Vector3d& vertex : geometry.vertices) {
      lower = lower.cwiseMin(vertex);
      upper = upper.cwiseMax(vertex);
    }
    center_ = (lower + upper) / 2;
    half_ = (upper - lower) / 2;
  }
}

Eigen::Vector3d Piece::HalfExtent() const {
  const Eigen::Matrix3d R_WG = X_WG_.linear();
  const Eigen::Vector3d& size = geometry_.size;
  using enum sim::Geometry::Shape;
  switch (geometry_.shape) {
    case kBox:
      return R_WG.cwiseAbs() * size;
    case kSphere:
      return Eigen::Vector3d::Constant(size.x());
    case kCapsule:
      return (R_WG.col(2).cwiseAbs() * size.y()).array() + size.x();
    case kCylinder: {
      const Eigen::Array3d axis = R_WG.col(2).array();
      return axis.abs() * size.y() + size.x() * (1 - axis.square()).max(0.0).sqrt();
    }
    case kConvex:
      return R_WG.cwiseAbs() * half_;
  }
  return Eigen::Vector3d::Zero();
}

void Piece::Place(const Eigen::Isometry3d& X_WB) {
  X_WG_ = X_WB * X_BG_;
  const Eigen::Vector3d center = X_WG_ * center_;
  const Eigen::Vector3d half = HalfExtent();
  lower_ = center - half;
  upper_ = center + half;
}

void Piece::SetMargin(double margin) {
  inflated_.reset();
  if (margin > 0 && geometry_.shape != sim::Geometry::Shape::kConvex) inflated_.emplace(geometry_, margin);
}

double AabbGap(const Piece& a, const Piece& b) {
  return std::max((a.lower() - b.upper()).maxCoeff(), (b.lower() - a.upper()).maxCoeff());
}

namespace {

bool Near(const Piece& a, const Piece& b, double margin, const std::optional<Shape>& grown_a,
          const std::optional<Shape>& grown_b) {
  if (AabbGap(a, b) > margin) return false;
  if (margin <= 0) return Touch(a.shape(), a.X_WG(), b.shape(), b.X_WG());
  if (grown_a) return Touch(*grown_a, a.X_WG(), b.shape(), b.X_WG());
  if (grown_b) return Touch(a.shape(), a.X_WG(), *grown_b, b.X_WG());
  return Distance(a.shape(), a.X_WG(), b.shape(), b.X_WG()) <= margin;
}

}  // namespace

bool Near(const Piece& a, const Piece& b, double margin) { return Near(a, b, margin, a.inflated(), b.inflated()); }

bool NearSelf(const Piece& a, const Piece& b, double margin, bool apart) {
  const double kept = margin < kSelfMargin ? 0 : apart ? kSelfRoom : kSelfMargin;
  return Near(a, b, kept, a.self_inflated(apart), b.self_inflated(apart));
}

}  // namespace etude::collide::internal
