// SPDX-License-Identifier: Apache-2.0
// Sizes that the stages compute their goals from, measured once from the scene's collision pieces.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "services/spec/task_spec.h"
#include "worker/sim/world.h"

namespace etude::task {

/// Largest value of `direction` (unit, in W) over the piece at X_WG, m.
double Support(const sim::Geometry& piece, const Pose& X_WG, const Eigen::Vector3d& direction);

/// The hand that approaches along (0, cos pitch, -sin pitch), fingers closing along x: 0 is level, pi/2 points
/// straight down.
Eigen::Quaterniond Hand(double pitch);
/// Hand(0): Euler rxyz (pi, 0, pi/2).
Eigen::Quaterniond LevelHand();
/// Hand(pi/2): Euler rxyz (pi/2, 0, pi/2).
Eigen::Quaterniond TurnedHand();
/// Unit vector along which Hand(pitch) approaches, in W.
Eigen::Vector3d ApproachOf(double pitch);

/// Unit vector in W from the reference to a place beside it, as seen in the picture: right is -x, the front (towards
/// the camera) +y. @pre kLeft | kRight | kFront | kBehind
Eigen::Vector3d DirectionOf(Whereto to);

/// Immutable after construction.
class SceneGeometry {
 public:
  enum class Part { kFingers, kPalm, kHand };  ///< kHand: both

  SceneGeometry(const sim::Scene& scene, sim::Kinematics& kinematics);

  /// How far the fingers reach beyond E in the approach direction, open (0) or closed (1), m.
  double ahead_open() const { return ahead_open_; }
  double ahead_closed() const { return ahead_closed_; }
  /// How far the palm reaches beyond E in the approach direction, m: negative.
  double palm_ahead() const { return palm_ahead_; }
  /// Reach beyond E along `direction` (unit, W) of the hand oriented q_WE, m.
  double Reach(Part part, bool closed, const Eigen::Quaterniond& q_WE, const Eigen::Vector3d& direction) const;

  /// The same of the whole hand, whatever the fingers do: half closed they may reach further than open or closed.
  double FurthestReach(const Eigen::Quaterniond& q_WE, const Eigen::Vector3d& direction) const;

  /// Pitch at which the robot's hand comes at an object by nature, rad.
  double natural_pitch() const { return natural_pitch_; }
  /// Pitch after it has turned an object over by 90 degrees, rad.
  double turned_pitch() const { return turned_pitch_; }
  /// See sim::ArmInfo.
  bool turns_any_way() const { return turns_any_way_; }
  /// The speed to plan for that the slowest joint has, rad/s.
  double joint_speed() const { return joint_speed_; }
  /// x, y of the first joint's vertical axis, m.
  const Eigen::Vector2d& base() const { return base_; }

  /// Size and mass of one object. @pre the scene has it
  const sim::ObjectInfo& object(const std::string& name) const;
  /// Centre of the upright bounding box in the body's frame, m.
  Eigen::Vector3d Centre(const std::string& name) const;
  /// Height of the body's origin above the table when it touches it, oriented q_WO, m.
  double HeightOnTable(const std::string& name, const Eigen::Quaterniond& q_WO) const;

 private:
  using Placed = std::vector<std::pair<sim::Geometry, Pose>>;  // with X_EG

  void MeasureHand(const sim::Scene& scene, sim::Kinematics& kinematics);

  std::vector<sim::ObjectInfo> objects_;
  std::map<std::string, std::vector<sim::Geometry>> pieces_;
  Placed fingers_[3], palm_;  // fingers: open, half closed, closed
  double ahead_open_ = 0, ahead_closed_ = 0, palm_ahead_ = 0, natural_pitch_ = 0, turned_pitch_ = 0, joint_speed_ = 0;
  Eigen::Vector2d base_ = Eigen::Vector2d::Zero();
  bool turns_any_way_ = true;
};

}  // namespace etude::task
