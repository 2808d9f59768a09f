// SPDX-License-Identifier: Apache-2.0
// From a policy's answers, a few each second, to a reference for the hand in every control step.
#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "services/episode/action.h"
#include "worker/task/episode_runner.h"

namespace etude::task {

/// Whether the fingers shall be closed by a waypoint's `gripper` when they were told `closed` before: a wavering answer
/// does not make them flutter.
bool ShallClose(double gripper, bool closed);

/// Whether fingers still move on their last command, told by what is measured of them.
class FingerWait {
 public:
  /// @param control_delay  steps until the world obeys a command (WorldSpec)
  explicit FingerWait(int control_delay = 0) : delay_(control_delay) {}

  /// They were told to close or to open; while they still move, the wait for them gets no longer by it.
  void Begin(bool close);
  /// To be asked once each control step.
  /// @param gripper  how far they are closed now: 0 open .. 1 closed
  /// @returns whether they move. For no longer than the slowest hand takes to close; an opening is waited for as long
  /// as the expert does, who leaves while the fingers still open.
  bool Moving(double gripper);
  /// Whether they moved when it was asked last, or were told to since.
  bool moving() const { return left_ > 0; }

 private:
  int delay_;
  int left_ = 0;     // control steps that are waited at most
  int steps_ = 0;    // since the command
  int at_rest_ = 0;  // of these, the last in which they did not move
  double last_ = 0;
};

/// Turns the waypoints of successive answers into references that neither move faster than the arm should nor change
/// their velocity faster, whatever an answer says after the one before.
class Tracker {
 public:
  /// Which share (0..1] of a velocity of the hand (m/s, rad/s; linear first, world) its joints can follow now.
  using SpeedShare = std::function<double(const Eigen::Matrix<double, 6, 1>&)>;

  Tracker(const Pose& X_WE, bool closed, SpeedShare share = nullptr, int control_delay = 0)
      : share_(std::move(share)), reference_(X_WE), closed_(closed), fingers_(control_delay) {}

  /// Begins to follow `waypoints` (kWaypoints of them) from their step `first`, which is for the next step, or from one
  /// soon after it that is nearer to the reference. While the fingers close, an answer that opens them only to close
  /// them again is let go: it shows how a grasp begins that has begun, and a hand that follows it opens and closes for
  /// ever.
  void Follow(std::vector<Waypoint> waypoints, int first = 0);
  /// The next step's command. Holds where it began until Follow is called. At a grasp and a release the path's time
  /// stands while the fingers move, as soon as the hand has come to where it grasps: one that rises while they close
  /// loses what is round, and a policy that never saw fingers closed over what it is to take does not open them again.
  /// @param gripper  how far the fingers are closed, as measured: 0 open .. 1 closed
  Command Next(double gripper);

 private:
  double ShareOf(const Eigen::Matrix<double, 6, 1>& V_WE) const { return share_ ? share_(V_WE) : 1; }
  /// @returns how many steps of the path's time went by, 0..1
  double Advance(const Pose& now, const Pose& next);
  /// Whether the path is still on its way to where it stands.
  bool Arriving() const;

  SpeedShare share_;
  std::vector<Waypoint> waypoints_;
  double step_ = 0;  // on the path
  Pose reference_;
  Eigen::Matrix<double, 6, 1> V_WE_ = Eigen::Matrix<double, 6, 1>::Zero();  // of the reference
  bool closed_;
  bool commanded_ = false;  // fingers that close with an answer's first step, to push, are not waited for
  FingerWait fingers_;
  std::optional<Pose> X_WE_waiting_;                             // where the hand stands meanwhile
  double since_wait_ = std::numeric_limits<double>::infinity();  // steps of the path since it stood last
};

}  // namespace etude::task
