// SPDX-License-Identifier: Apache-2.0
// A geometry of the scene with its shapes and where it is now. Internal to worker/collide.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <optional>
#include <string>

#include "worker/collide/narrowphase.h"

namespace etude::collide::internal {

enum class Role { kArm, kObject, kStatic };

/// m kept between bodies of the arm, however much is kept to others: what moves them apart from where they are planned
/// is the joints' error times a link, not the error of a place that was seen.
inline constexpr double kSelfMargin = 0.002;
/// m kept between those that are twice as far apart at home, where nothing makes them near: a policy follows what was
/// demonstrated to within a centimetre, and the folded arm has no more room than it was shown.
inline constexpr double kSelfRoom = 0.012;

Eigen::Isometry3d ToIsometry(const Pose& pose);

/// One convex piece of a body.
class Piece {
 public:
  Piece(const sim::Geometry& geometry, Role role, int body);

  /// Moves the piece with its body and recomputes the world's AABB.
  void Place(const Eigen::Isometry3d& X_WB);
  void Place(const Eigen::Matrix3d& R_WB, const Eigen::Vector3d& p_WB);
  /// Makes the shape grown by `margin` (m); a convex mesh has none.
  void SetMargin(double margin);

  Role role() const { return role_; }
  int body() const { return body_; }
  const std::string& body_name() const { return geometry_.body; }
  const Shape& shape() const { return shape_; }
  const std::optional<Shape>& inflated() const { return inflated_; }
  /// Grown by kSelfMargin or, of a pair that is `apart`, by kSelfRoom; a convex mesh has none.
  const std::optional<Shape>& self_inflated(bool apart) const { return apart ? self_roomy_ : self_inflated_; }
  const Eigen::Isometry3d& X_WG() const { return X_WG_; }
  const Eigen::Vector3d& lower() const { return lower_; }
  const Eigen::Vector3d& upper() const { return upper_; }
  /// A capsule around the piece, in the world.
  struct Capsule {
    Eigen::Vector3d center, half_axis;  ///< m; its axis goes from center - half_axis to center + half_axis
    double radius;                      ///< m
  };
  const Capsule& capsule() const { return capsule_; }

 private:
  Eigen::Vector3d HalfExtent(const Eigen::Matrix3d& R_WG) const;
  void FindCapsule();

  sim::Geometry geometry_;
  Role role_;
  int body_;
  Shape shape_;
  std::optional<Shape> inflated_, self_inflated_, self_roomy_;
  Eigen::Matrix3d R_BG_;
  Eigen::Vector3d p_BG_;
  Eigen::Vector3d center_, half_;  ///< AABB of the vertices in G, kConvex only
  Eigen::Isometry3d X_WG_ = Eigen::Isometry3d::Identity();
  Eigen::Vector3d lower_ = Eigen::Vector3d::Zero(), upper_ = Eigen::Vector3d::Zero();
  int axis_ = 2;            ///< of G, along which the capsule lies
  double half_length_ = 0;  ///< m, half of the capsule's axis
  Capsule capsule_{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero(), 0};
};

/// Largest gap of the two AABBs along an axis, a lower bound of the distance; negative when they
/// overlap. Inline: most of a check is some hundreds of these.
inline double AabbGap(const Piece& a, const Piece& b) {
  return std::max((a.lower() - b.upper()).maxCoeff(), (b.lower() - a.upper()).maxCoeff());
}
/// Gap of the two capsules, a lower bound of the distance; negative when they overlap.
double CapsuleGap(const Piece& a, const Piece& b);
/// True when the pieces are closer than the margin last set (see the folder's README on inflation).
bool Near(const Piece& a, const Piece& b, double margin);
/// The same for two pieces of the arm: without a margin when `margin` is less than kSelfMargin, else at kSelfRoom for
/// those that are `apart` at home and at kSelfMargin for others.
bool NearSelf(const Piece& a, const Piece& b, double margin, bool apart);

}  // namespace etude::collide::internal
