// SPDX-License-Identifier: Apache-2.0
// The expert: plans the stages of a task one after another and plays them.
#pragma once

#include <string>
#include <vector>

#include "worker/task/chain.h"
#include "worker/task/disturbance.h"
#include "worker/task/session.h"
#include "worker/task/stage.h"

namespace etude::task {

struct Verdict {
  AttemptOutcome outcome = AttemptOutcome::kSuccess;
  std::string reason;
  bool ok() const { return outcome == AttemptOutcome::kSuccess; }
};

/// Plays one attempt in a session. Its plans and pushes are functions of `seed` and the session's state.
class Expert {
 public:
  Expert(Session* session, StagePlanner* planner, collide::Checker* checker, const RandomizationSpec& randomization,
         std::uint64_t seed);

  /// Runs all stages; says where and why it stopped.
  Verdict Run();
  /// How each stage was planned, and the pushes: for Episode::details. No timings.
  OrderedJson Statistics() const;

 private:
  struct Piece {  // a run of stages that is played without stopping
    plan::Motion motion;
    std::vector<int> stage;                // per step
    std::vector<Eigen::Vector3d> goal;     // of each stage, by index - first
    int first = 0, last = 0;               // stages
    std::vector<Eigen::Vector3d> avoided;  // where what has to be avoided was when it was planned
  };
  struct Interruption {
    int at = -1;  // step of the piece; -1: none
    plan::Motion motion;
  };

  void UpdateChecker(const Stage& stage);
  Situation Now() const;
  Verdict PlanPiece(int first, Piece& piece);
  /// One try. @param by_field  whether stages with a clearance go down the potential field
  Verdict TryPiece(int first, bool by_field, Piece& piece);
  Verdict PlayPiece(const Piece& piece, int& next_stage);
  Interruption DrawInterruption(const Piece& piece);
  Verdict PlayWait(int stage);
  Verdict PlayStep(int stage, const Pose& X_WE, const Vector6& V_WE, bool supervise);
  Verdict AfterWait(int stage);
  Verdict Settle(int stage, const Pose& goal);
  Verdict Check(int stage) const;
  Verdict FinalCheck() const;
  Verdict Stopped(int stage) const;
  Surroundings Around(const Situation& now) const;
  std::vector<Eigen::Vector3d> AvoidedPlaces() const;
  /// Plans the rest of `stage` anew when something that has to be avoided moved into the way. `rest` gets it.
  Verdict AvoidWhatMoved(const Piece& piece, int step, std::optional<Piece>& rest);

  Session* session_;
  StagePlanner* planner_;
  collide::Checker* checker_;
  RandomizationSpec randomization_;
  std::uint64_t seed_;
  Rng push_rng_;
  std::vector<Stage> stages_;
  std::vector<bool> push_drawn_;  // by stage: whether its one chance of a push is used up
  Pose reference_;                // last commanded pose
  std::optional<Pose> X_EO_;      // while held
  int plans_ = 0, pushes_ = 0, replans_ = 0;
  OrderedJson planned_ = OrderedJson::array();
};

}  // namespace etude::task
