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
      R_BG_(geometry.X_BG.q.toRotationMatrix()),
      p_BG_(geometry.X_BG.p),
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
  FindCapsule();
}

void Piece::FindCapsule() {
  using enum sim::Geometry::Shape;
  if (geometry_.shape == kBox || geometry_.shape == kConvex) {
    const Eigen::Vector3d half = geometry_.shape == kBox ? geometry_.size : half_;
    half_length_ = half.maxCoeff(&axis_);
    capsule_.radius = std::sqrt(std::max(0.0, half.squaredNorm() - half_length_ * half_length_));
  } else {
    half_length_ = geometry_.shape == kSphere ? 0 : geometry_.size.y();
    capsule_.radius = geometry_.size.x();
  }
}

Eigen::Vector3d Piece::HalfExtent(const Eigen::Matrix3d& R_WG) const {
  const Eigen::Vector3d& size = geometry_.size;
  using enum sim::Geometry::Shape;
  switch (geometry_.shape) {
    case kBox:
      return R_WG.cwiseAbs().lazyProduct(size);
    case kSphere:
      return Eigen::Vector3d::Constant(size.x());
    case kCapsule:
      return (R_WG.col(2).cwiseAbs() * size.y()).array() + size.x();
    case kCylinder: {
      const Eigen::Array3d axis = R_WG.col(2).array();
      return axis.abs() * size.y() + size.x() * (1 - axis.square()).max(0.0).sqrt();
    }
    case kConvex:
      return R_WG.cwiseAbs().lazyProduct(half_);
  }
  return Eigen::Vector3d::Zero();
}

// The products are written out: of a check that moves every piece, half would go into calls of Eigen's.
void Piece::Place(const Eigen::Matrix3d& R_WB, const Eigen::Vector3d& p_WB) {
  const Eigen::Matrix3d R_WG = R_WB.lazyProduct(R_BG_);
  const Eigen::Vector3d p_WG = R_WB.lazyProduct(p_BG_) + p_WB;
  X_WG_.linear() = R_WG;
  X_WG_.translation() = p_WG;
  const bool convex = geometry_.shape == sim::Geometry::Shape::kConvex;
  capsule_.center = p_WG;
  if (convex) capsule_.center += R_WG.lazyProduct(center_);
  capsule_.half_axis = R_WG.col(axis_) * half_length_;
  const Eigen::Vector3d half = HalfExtent(R_WG);
  lower_ = capsule_.center - half;
  upper_ = capsule_.center + half;
}

void Piece::Place(const Eigen::Isometry3d& X_WB) { Place(X_WB.linear(), X_WB.translation()); }

void Piece::SetMargin(double margin) {
  inflated_.reset();
  if (margin > 0 && geometry_.shape != sim::Geometry::Shape::kConvex) inflated_.emplace(geometry_, margin);
}

// Source: Ericson, Real-Time Collision Detection (2005), 5.1.9, for segments given by centre and half.
double CapsuleGap(const Piece& a, const Piece& b) {
  const Eigen::Vector3d &u = a.capsule().half_axis, &v = b.capsule().half_axis;
  const Eigen::Vector3d w = a.capsule().center - b.capsule().center;
  const double uu = u.squaredNorm(), vv = v.squaredNorm(), uv = u.dot(v), uw = u.dot(w), vw = v.dot(w);
  const auto unit = [](double value) { return std::clamp(value, -1.0, 1.0); };
  // nearest: w + s u - t v, s and t from -1 to 1
  const double cross = uu * vv - uv * uv;
  double s = cross > 1e-12 * uu * vv ? unit((uv * vw - vv * uw) / cross) : 0;
  const double t = vv > 0 ? unit((uv * s + vw) / vv) : 0;
  s = uu > 0 ? unit((uv * t - uw) / uu) : 0;
  return (w + s * u - t * v).norm() - a.capsule().radius - b.capsule().radius;
}

namespace {

// m by which bodies must be apart for what FCL would say to be known: many times what it is off for a verdict
constexpr double kClear = 1e-4;
// a box grown by a margin along its axes reaches further at its corners
constexpr double kCorner = 1.7321;

bool Near(const Piece& a, const Piece& b, double margin, const std::optional<Shape>& grown_a,
          const std::optional<Shape>& grown_b) {
  if (AabbGap(a, b) > margin || CapsuleGap(a, b) > kCorner * margin + kClear) return false;
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
