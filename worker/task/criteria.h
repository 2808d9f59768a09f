// SPDX-License-Identifier: Apache-2.0
// When a task counts as done. One definition for demonstrations and rollouts.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "services/episode/pose.h"

namespace etude::task {

inline constexpr double kPickRise = 0.03;           ///< m above where the object stood
inline constexpr double kPushDistance = 0.03;       ///< m along +y
inline constexpr double kLiftedHeight = 0.10;       ///< m, put_down, rotate: origin above the table once
inline constexpr double kLaidHeight = 0.08;         ///< m, put_down: origin below this afterwards
inline constexpr double kLyingTilt = 0.7;           ///< rad, a lying cone (a pear) leans that much
inline constexpr double kTurnTolerance = 0.5;       ///< rad, put_down, rotate: norm of the Euler error
inline constexpr double kDisturbedDistance = 0.02;  ///< m, another object moved
inline constexpr double kBeside = 0.12;             ///< m, relations: where the expert puts the target, and
inline constexpr double kBefore = 0.16;             ///< m, in front of or behind the reference: a hand fits between
inline constexpr double kBesideNear = 0.04;         ///< m, relations: at least along the relation's axis,
inline constexpr double kBesideFar = 0.20;          ///< m, at most,
inline constexpr double kBesideAside = 0.05;        ///< m, and at most across it
inline constexpr double kAtRest = 0.03;             ///< m/s, relations: slower counts as standing
inline constexpr int kRestSteps = 10;               ///< control steps that it stands

/// What a criterion looks at, once a control step.
struct Observed {
  Pose X_WO;          ///< target
  Pose X_WR;          ///< relations: the reference
  bool held = false;  ///< the robot touches the target
};

/// Latched success of one task on one object. Feed it every control step.
///   pick      the object rose by more than kPickRise
///   push      it moved by more than kPushDistance along +y
///   rotate    while it was above kLiftedHeight it was turned over (below)
///   put_down  it was above kLiftedHeight; afterwards it was turned over: turned by 90 degrees about x, either
///             way (Euler rxyz of R_now R_start^T within kTurnTolerance of (+-pi/2, 0, 0)), and it was below
///             kLaidHeight
///   place_*   it rose by more than kPickRise; afterwards it rests, released, beside the reference, see IsBeside
class SuccessCriterion {
 public:
  /// @param task  one of BaseTasks()   @param X_WO_start  the object before anything moved
  SuccessCriterion(std::string task, const Pose& X_WO_start);

  void Observe(const Observed& now);
  bool success() const;

  /// Furthest progress in the task's own quantity (m): rise, push distance, or greatest height.
  double progress() const { return progress_; }
  bool lifted() const { return lifted_; }
  bool turned() const { return turned_; }
  bool laid() const { return laid_; }
  bool beside() const { return beside_; }

 private:
  void ObserveTurn(const Pose& X_WO);
  void ObserveRelation(const Observed& now);

  std::string task_;
  Pose X_WO_start_;
  Eigen::Vector3d p_before_;
  double progress_ = 0;
  int rested_ = 0;  // control steps
  bool moved_ = false, lifted_ = false, turned_ = false, laid_ = false, beside_ = false;
};

/// Euler error of the rotation by 90 degrees about x, the nearer way, rad.
double TurnError(const Pose& X_WO, const Pose& X_WO_start);
/// True when the object's vertical axis lies within kLyingTilt of the horizontal and it is on the table.
bool LiesDown(const Pose& X_WO);
/// The direction of a relation in W, as seen in the picture: right is -x, the front (towards the camera) +y.
/// @pre place_left | place_right | place_front | place_behind
Eigen::Vector3d DirectionOf(const std::string& relation);
/// True when the target is between kBesideNear and kBesideFar along the relation's direction from the reference,
/// and at most kBesideAside off it.
bool IsBeside(const std::string& relation, const Eigen::Vector3d& p_WO, const Eigen::Vector3d& p_WR);

/// Largest displacement of every object but the target.
class DisturbanceWatch {
 public:
  DisturbanceWatch(std::vector<std::pair<std::string, Pose>> others);
  void Observe(const std::string& name, const Pose& X_WO);
  /// Objects that moved by more than kDisturbedDistance, in order of name.
  std::vector<std::string> disturbed() const;

 private:
  struct Entry {
    Eigen::Vector3d start;
    double most = 0;
  };
  std::map<std::string, Entry> entries_;
};

}  // namespace etude::task
