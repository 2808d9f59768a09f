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
inline constexpr double kLiftedHeight = 0.10;       ///< m, put_down: origin above the table once
inline constexpr double kLaidHeight = 0.08;         ///< m, put_down: origin below this afterwards
inline constexpr double kTurnTolerance = 0.5;       ///< rad, put_down: norm of the Euler error
inline constexpr double kDisturbedDistance = 0.02;  ///< m, another object moved

/// Latched success of one task on one object. Feed it every control step.
///   pick      the object rose by more than kPickRise
///   push      it moved by more than kPushDistance along +y
///   put_down  it was above kLiftedHeight; afterwards it was turned by -90 degrees about x (Euler rxyz of
///             R_now R_start^T within kTurnTolerance of (-pi/2, 0, 0)) and it was below kLaidHeight
class SuccessCriterion {
 public:
  /// @param task  pick | push | put_down   @param X_WO_start  the object before anything moved
  SuccessCriterion(std::string task, const Pose& X_WO_start);

  void Observe(const Pose& X_WO);
  bool success() const;

  /// Furthest progress in the task's own quantity (m): rise, push distance, or greatest height.
  double progress() const { return progress_; }
  bool lifted() const { return lifted_; }
  bool turned() const { return turned_; }
  bool laid() const { return laid_; }

 private:
  std::string task_;
  Pose X_WO_start_;
  double progress_ = 0;
  bool moved_ = false, lifted_ = false, turned_ = false, laid_ = false;
};

/// Euler error of the put_down rotation, rad.
double TurnError(const Pose& X_WO, const Pose& X_WO_start);
/// True when the object's vertical axis lies within 0.35 rad of the horizontal and it is on the table.
bool LiesDown(const Pose& X_WO);

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
