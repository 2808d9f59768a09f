// SPDX-License-Identifier: Apache-2.0
// A policy at the controls: asked every few control steps, its waypoints tracked until the next answer.
#pragma once

#include <functional>
#include <optional>

#include "services/policy/policy_types.h"
#include "worker/collide/checker.h"
#include "worker/task/command_guard.h"
#include "worker/task/episode_runner.h"
#include "worker/task/target_pushes.h"
#include "worker/task/tracker.h"
#include "worker/task/verdict.h"

namespace etude::task {

/// Why the answer cannot be followed: wrong count, a number that is not finite, a pose out of any reach.
/// Empty when it can.
std::string RefusalOf(const policy::Answer& answer);

/// Control steps until a rollout of `robot` counts as a failure.
int StepLimitOf(const RolloutSpec& spec, const std::string& robot);

class Rollout {
 public:
  /// `checker` measures distances, for the record and for pushes of the target.
  Rollout(EpisodeRunner* runner, collide::Checker* checker, std::shared_ptr<const sim::Scene> scene,
          const RolloutSpec& spec, std::string instruction);

  /// The policy drives until the strict condition has held for its dwell, or to the step limit. An answer takes effect
  /// spec.latency_ms after its picture; until then the simulation goes on with the one before. Where the hand goes
  /// nowhere one answer is followed for as long as it spans (standstill.h).
  /// @error what `policy` returns
  /// @param closed  whether the fingers are closed at the start
  Result<Verdict> Run(const policy::AskFunction& ask, bool closed = false);
  /// Per-decision errors and the outcome's circumstances, for Episode::details.
  OrderedJson Details(const Verdict& verdict) const;

 private:
  Result<Verdict> RunTracked(const policy::AskFunction& ask, bool closed);
  Result<Verdict> RunAsAuthors(const policy::AskFunction& ask, bool closed);
  /// The answer to a new question, noted, or why it cannot be followed.
  Result<tl::expected<policy::Answer, Verdict>> Decide(const policy::AskFunction& ask);
  Result<policy::Answer> Ask(const policy::AskFunction& ask);
  void RecordDecision(const policy::Answer& answer);
  /// By the guard; its distance queries count as planning.
  Command Guarded(const Command& command);
  Verdict Failed() const;
  void ObserveDistance();
  /// How many control steps pass before an answer takes effect; settled by the first answer of a server that knows its
  /// own.
  int LatencySteps(const policy::Answer& answer);
  /// See Tracker::SpeedShare: no joint has to go near its limit.
  double SpeedShareOf(const Eigen::Matrix<double, 6, 1>& V_WE);
  /// How far what a module says is from the truth, m; nothing where the truth is not known or it says no place.
  std::optional<double> ErrorOf(const OrderedJson& output) const;
  std::optional<Eigen::Vector3d> PlaceOf(const std::string& entity) const;

  EpisodeRunner* runner_;
  collide::Checker* checker_;
  sim::Kinematics kinematics_;
  CommandGuard guard_;
  RolloutSpec spec_;
  std::string instruction_;
  double nearest_ = 1e9;
  std::string nearest_pair_;
  int latency_steps_ = -1;
  OrderedJson decisions_ = OrderedJson::array();
  std::optional<TargetPushes> pushes_;
};

}  // namespace etude::task
