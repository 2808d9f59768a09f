// SPDX-License-Identifier: Apache-2.0
// A policy at the controls: asked every few control steps, its waypoints tracked until the next answer.
#pragma once

#include <optional>

#include "services/policy/policy_types.h"
#include "worker/collide/checker.h"
#include "worker/task/episode_runner.h"
#include "worker/task/verdict.h"

namespace etude::task {

/// Why the answer cannot be followed: wrong count, a number that is not finite, a pose out of any reach.
/// Empty when it can.
std::string RefusalOf(const policy::Answer& answer);

/// Turns the waypoints of successive answers into references that never move faster than the arm should.
class Tracker {
 public:
  Tracker(const Pose& X_WE, bool closed) : reference_(X_WE), closed_(closed) {}

  /// Begins to follow `waypoints` (kWaypoints of them) from their step `first`, which is for the next step.
  void Follow(std::vector<Waypoint> waypoints, int first = 0);
  /// Holds where it began until Follow is called.
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
  Rollout(EpisodeRunner* session, collide::Checker* checker, const RolloutSpec& spec, std::string instruction);

  /// The policy drives until the strict condition has held for its dwell, or to the step limit. An answer takes effect
  /// spec.latency_ms after its picture; until then the simulation goes on with the one before.
  /// @error what `policy` returns
  Result<Verdict> Run(const policy::AskFunction& ask);
  /// Per-decision errors and the outcome's circumstances, for Episode::details.
  OrderedJson Details(const Verdict& verdict) const;

 private:
  Result<policy::Answer> Ask(const policy::AskFunction& ask);
  void RecordDecision(const policy::Answer& answer);
  void ObserveDistance();
  /// How many control steps pass before an answer takes effect; settled by the first answer of a server that knows its own.
  int LatencySteps(const policy::Answer& answer);
  /// How far what a module says is from the truth, m; nothing where the truth is not known or it says no place.
  std::optional<double> ErrorOf(const OrderedJson& output) const;
  std::optional<Eigen::Vector3d> PlaceOf(const std::string& entity) const;

  EpisodeRunner* session_;
  collide::Checker* checker_;
  RolloutSpec spec_;
  std::string instruction_;
  double nearest_ = 1e9;
  std::string nearest_pair_;
  int latency_steps_ = -1;
  OrderedJson decisions_ = OrderedJson::array();
};

}  // namespace etude::task
