// SPDX-License-Identifier: Apache-2.0
// Collision and distance queries of the arm against itself, the table and the objects, with FCL.
// Only worker/collide includes fcl/*.
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "worker/sim/world.h"

namespace etude::collide {

struct Collision {
  std::string body_a, body_b;   ///< arm body first
  double distance = 0;          ///< m; <= 0 in collision
};

/// One per thread (it owns kinematics and FCL objects).
class Checker {
 public:
  explicit Checker(std::shared_ptr<const sim::Scene> scene);
  Checker(Checker&&) noexcept;
  ~Checker();

  /// Where the objects are now.
  void SetObject(const std::string& name, const Pose& X_WO);
  /// Gripper opening used for the fingers' pose, 0 open .. 1 closed.
  void SetGripper(double gripper);
  /// Contacts with these bodies are wanted (the target while it is grasped or pushed).
  void Allow(std::set<std::string> bodies);
  /// Object that moves with the tool: X_EO. Its contacts with the table are allowed. Nothing to detach.
  void Attach(const std::string& object, const std::optional<Pose>& X_EO);

  /// First collision at q, nothing when free. `margin` (m) inflates: pairs closer than it collide.
  std::optional<Collision> Check(const Eigen::VectorXd& q, double margin = 0.0);
  /// The straight joint-space segment a -> b at steps of at most `resolution` rad (largest joint).
  std::optional<Collision> CheckSegment(const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                                        double resolution = 0.02, double margin = 0.0);
  /// Nearest pair between arm (and what it holds) and the rest.
  Collision Nearest(const Eigen::VectorXd& q);
  std::uint64_t checks() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::collide
