// SPDX-License-Identifier: Apache-2.0
// A policy at the controls: asked every few control steps, its waypoints tracked until the next answer.
#pragma once

#include "worker/collide/checker.h"
#include "worker/task/expert.h"
#include "worker/task/session.h"

namespace etude::task {

/// Why the answer cannot be followed: wrong count, a number that is not finite, a pose out of any reach.
/// Empty when it can.
std::string RefusalOf(const PolicyAnswer& answer);

/// Turns the waypoints of successive answers into references that never move faster than the arm should.
class Tracker {
 public:
  Tracker(const Pose& X_WE, bool closed) : reference_(X_WE), closed_(closed) {}

  /// Begins to follow `waypoints` (kWaypoints of them), whose first is for the next step.
  void Follow(std::vector<Waypoint> waypoints);
  /// @pre Follow was called
  Command Next();

 private:
  std::vector<Waypoint> waypoints_;
  int step_ = 0;
  Pose reference_;
  bool closed_;
};

class Rollout {
 public:
  /// `checker` measures distances for the record.
  Rollout(Session* session, collide::Checker* checker, const RolloutSpec& spec, std::string instruction);

  /// Runs to success, failure or the step limit. @error what `policy` returns
  Result<Verdict> Run(const PolicyFunction& policy);
  /// Per-decision errors and the outcome's circumstances, for Episode::details.
  OrderedJson Details(const Verdict& verdict) const;

 private:
  Result<PolicyAnswer> Ask(const PolicyFunction& policy);
  void RecordDecision(const PolicyAnswer& answer);
  void ObserveDistance();

  Session* session_;
  collide::Checker* checker_;
  RolloutSpec spec_;
  std::string instruction_;
  bool touched_ = false;
  double nearest_ = 1e9;
  std::string nearest_pair_;
  int success_step_ = -1;
  OrderedJson decisions_ = OrderedJson::array();
};

}  // namespace etude::task
