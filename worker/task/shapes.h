// SPDX-License-Identifier: Apache-2.0
// Sizes that the stages compute their goals from, measured once from the scene's collision pieces.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "worker/sim/world.h"

namespace etude::task {

/// Largest value of `direction` (unit, in W) over the piece at X_WG, m.
double Support(const sim::Geometry& piece, const Pose& X_WG, const Eigen::Vector3d& direction);

/// The hand when it is level: approach direction +y, fingers close along x. Euler rxyz (pi, 0, pi/2).
Eigen::Quaterniond LevelHand();
/// The hand after the turn about x by -90 degrees: pointing down. Euler rxyz (pi/2, 0, pi/2).
Eigen::Quaterniond TurnedHand();

/// Immutable after construction.
class Shapes {
 public:
  Shapes(const sim::Scene& scene, sim::Kinematics& kinematics);

  /// How far the fingers reach beyond E in the approach direction, open (0) or closed (1), m.
  double ahead_open() const { return ahead_open_; }
  double ahead_closed() const { return ahead_closed_; }

  /// y of the first joint's vertical axis, m; its x is 0.
  double base_y() const { return base_y_; }

  /// Size and mass of one object. @pre the scene has it
  const sim::ObjectInfo& object(const std::string& name) const;
  /// Centre of the upright bounding box in the body's frame, m.
  Eigen::Vector3d Centre(const std::string& name) const;
  /// Height of the body's origin above the table when it touches it, oriented q_WO, m.
  double HeightOnTable(const std::string& name, const Eigen::Quaterniond& q_WO) const;

 private:
  double Ahead(const sim::Scene& scene, sim::Kinematics& kinematics, double gripper) const;

  std::vector<sim::ObjectInfo> objects_;
  std::map<std::string, std::vector<sim::Geometry>> pieces_;
  double ahead_open_ = 0, ahead_closed_ = 0, base_y_ = 0;
};

}  // namespace etude::task
